"""A table of Denavit and Hartenberg's four parameters, fitted where the model has five, and the frames around it.

The fifth (beta, between nearly parallel axes) has no column: base, links and tool are fitted again without it, and the
deviation says what that costs.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from identify.compensation.fitting import fitted, folded
from identify.export.chain import Segments, forward, origins
from identify.export.formats import Format, Forward, Original
from identify.model.cell import DEG
from identify.model.files import sheet_text
from identify.model.frames import pose, transform
from identify.model.io.calibration_file import Calibration
from identify.model.io.entries import POSE_KEYS, POSE_UNIT
from identify.model.robot import Robot

COLUMNS = ("theta_deg", "d_mm", "a_mm", "alpha_deg")
UNIT = np.array([DEG, 1.0, 1.0, DEG])
FAR = 50.0  # [mm]
FRAMES = ("jig_to_first", "last_to_tip")


def write(calibration: Calibration, original: Original | None) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """The table of links, and the two frames around it."""
    robot, start = calibration.cell.robot, calibration.theta.copy()
    betas = [i for i, name in enumerate(robot.parameters) if name.endswith(".beta")]
    free = [name for name in robot.parameters if not name.endswith(".beta")]
    if np.abs(start[betas]).max() > 0:
        start[betas] = 0.0
        start = fitted(calibration, free, start)
    links = robot.link_values(start)[:, :4] / UNIT
    kinds = ["prismatic" if slides else "revolute" for slides in robot.prismatic]
    table = sheet_text(
        {"joint": [joint.name for joint in robot.joints], "type": kinds} | dict(zip(COLUMNS, links.T, strict=True))
    )
    ends = np.array([pose(T) for T in folded(calibration, start)]) / POSE_UNIT
    frames = sheet_text({"frame": FRAMES} | dict(zip(POSE_KEYS, ends.T, strict=True)))
    return {".csv": table, "_frames.csv": frames}, _far(robot, calibration.cell.theta, start)


def _far(
    robot: Robot, nominal: Float[np.ndarray, " parameters"], theta: Float[np.ndarray, " parameters"]
) -> tuple[str, ...]:
    """A word about common normals that run away between nearly parallel axes."""
    shift = robot.link_values(theta - nominal)[:, 1]
    far = [f"{joint.name} {d:+.0f} mm" for joint, d in zip(robot.joints, shift, strict=True) if abs(d) > FAR]
    why = "nearly parallel axes have their common normal far away, and this format knows no other"
    return (f"d moved far: {', '.join(far)}; {why}",) if far else ()


def read(files: Mapping[str, str], calibration: Calibration) -> Forward:
    """jig_T_tip by Rz(theta) Trans(a, 0, d) Rx(alpha), one after the other."""
    rows = [line.split(",") for line in files[".csv"].splitlines()[1:]]
    ends = np.array([[float(cell) for cell in line.split(",")[1:]] for line in files["_frames.csv"].splitlines()[1:]])
    links = np.array([[float(cell) for cell in row[2:]] for row in rows]) * UNIT
    prismatic = tuple(row[1] == "prismatic" for row in rows)
    first, last = transform(ends * POSE_UNIT)
    zero = np.zeros(len(links))
    theta, d, a, alpha = links.T
    turned = transform(np.stack([zero, zero, zero, theta, zero, zero], axis=1))
    step = transform(np.stack([a, zero, d, zero, zero, alpha], axis=1))
    chain = Segments(first, tuple(turned @ step), last, prismatic)

    def tip(q: Float[np.ndarray, "poses joints"]) -> Float[np.ndarray, "poses 4 4"]:
        return forward(origins(chain), prismatic, q)

    return tip


FORMAT = Format(".csv", write, read)
