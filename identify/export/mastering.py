"""Joint zeros, tool frame and base frame as text, for a controller that takes nothing else.

They are fitted together so that the nominal links with these zeros and frames come nearest to the identified robot; a
zero that base or tool carry already stays 0. The deviation says what is left.
"""

import re
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from identify.compensation.compensate import believed, tip_transform
from identify.compensation.fitting import fitted, independent
from identify.export.formats import Format, Forward, Original, deviation
from identify.model.io.calibration_file import Calibration
from identify.model.io.entries import POSE_KEYS, POSE_UNIT
from identify.model.robot import POSE_NAMES

HEADING = "{:12}{:>14}{:>26}"


def write(calibration: Calibration, original: Original | None) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """The text."""
    cell, start = calibration.cell, believed(calibration)
    frames = [f"{frame}.{name}" for frame in ("base", "tool") for name in POSE_NAMES]
    zeros = [f"{joint.name}.{'d' if joint.prismatic else 'theta'}" for joint in cell.robot.joints]
    free = independent(calibration, [*frames, *zeros])
    theta = fitted(calibration, free, start)
    offsets = np.array([theta[i] - start[i] for i in map(cell.robot.parameters.index, zeros)])
    lines = [
        f"Joint zeros and frames of robot '{cell.robot.name}'",
        "",
        HEADING.format("joint", "offset", "shown at true zero"),
    ]
    zero, display = cell.robot.to_controller(np.zeros(len(offsets))), cell.robot.to_controller(0.0 - offsets)
    for i, (joint, name) in enumerate(zip(cell.robot.joints, zeros, strict=True)):
        word = "mm" if joint.prismatic else "deg"
        carried = "" if name in free else "   carried by base or tool"
        lines.append(
            HEADING.format(joint.name, f"{zero[i] - display[i]:.6f} {word}", f"{display[i]:.6f} {word}") + carried
        )
    there = "zero" if not cell.robot.counting.differs else ", ".join(f"{value:g}" for value in zero)
    lines += [
        "",
        "An arm that shows q stands at q + offset: drive each joint to what it shows at its true zero, and",
        f"set it to {there} there. Then enter the frames.",
        "",
    ]
    for title, values in (("tool frame (flange to tip)", theta[-6:]), ("base frame (jig to base)", theta[:6])):
        lines.append(
            f"{title}: " + ", ".join(f"{k} {v:.6f}" for k, v in zip(POSE_KEYS, values / POSE_UNIT, strict=True))
        )
    nothing = deviation(calibration, lambda q: tip_transform(calibration, q, start))
    remainder = deviation(calibration, lambda q: tip_transform(calibration, q, theta))
    lines += [
        "",
        "Tip error against the identified robot, mean / max:",
        f"  nothing done {nothing.mean_mm:.3f} / {nothing.max_mm:.3f} mm",
        f"  these zeros and frames {remainder.mean_mm:.3f} / {remainder.max_mm:.3f} mm",
        "",
    ]
    return {".txt": "\n".join(lines)}, ()


def read(files: Mapping[str, str], calibration: Calibration) -> Forward:
    """jig_T_tip of the nominal links with the zeros and frames of the text."""
    robot, theta, text = calibration.cell.robot, believed(calibration), files[".txt"]
    zero = robot.to_controller(np.zeros(len(robot.joints)))
    rows = [re.search(rf"^{re.escape(joint.name)}\s+(-?[\d.]+) (deg|mm)", text, re.MULTILINE) for joint in robot.joints]
    offsets = robot.from_controller(zero + np.array([float(row[1]) for row in rows if row is not None]))
    for joint, offset in zip(robot.joints, offsets, strict=True):
        theta[robot.parameters.index(f"{joint.name}.{'d' if joint.prismatic else 'theta'}")] += offset
    for title, part in (("base frame", slice(0, 6)), ("tool frame", slice(-6, None))):
        line = next(row for row in text.splitlines() if row.startswith(title))
        theta[part] = np.array([float(v) for v in re.findall(r"_(?:mm|deg) (-?[\d.]+)", line)]) * POSE_UNIT

    def tip(q: Float[np.ndarray, "poses joints"]) -> Float[np.ndarray, "poses 4 4"]:
        return tip_transform(calibration, q, theta)

    return tip


FORMAT = Format(".txt", write, read)
