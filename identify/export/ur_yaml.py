"""`kinematics:` as the description of a UR arm reads it: six origins, metres and radians, and a hash of them.

The format ends at the last joint: a part of the flange's place that no motion of that joint can carry is lost, and the
deviation says what that costs.
"""

import hashlib
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from ruamel.yaml import YAML

from identify.export.chain import Transform, forward, origins, segments
from identify.export.formats import Format, Forward, Original
from identify.export.urdf import corrected_origins
from identify.model.files import InputError
from identify.model.frames import pose, transform
from identify.model.io.calibration_file import Calibration
from identify.model.urdf.document import METRE

NAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
LOST = 1e-9  # [mm] or [rad]


def write(calibration: Calibration, original: Original | None) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """The YAML text; with the original URDF, frames stand where its own do."""
    robot = calibration.cell.robot
    if len(robot.joints) != 6 or any(robot.prismatic):
        raise InputError(f"ur-yaml is for six turning joints; robot '{robot.name}' has others: take urdf or json")
    frames = _moved(origins(segments(robot, calibration.theta)))
    if original is not None:
        _, joints, own = corrected_origins(calibration, original)
        if any(np.abs(joint.axis - [0, 0, 1]).max() > LOST for joint in joints[:6]):
            raise InputError(f"{original.path}: ur-yaml needs joints that turn about z (axis 0 0 1); leave --urdf out")
        frames = own
    lines = ["kinematics:"]
    for name, T in zip(NAMES, frames[:6], strict=True):
        x, y, z, rz, ry, rx = (float(v) for v in pose(T))
        values = (x / METRE, y / METRE, z / METRE, rx, ry, rz)
        lines += [f"  {name}:", *(f"    {key}: {value + 0.0!r}" for key, value in zip(KEYS, values, strict=True))]
    number = int.from_bytes(hashlib.sha256("\n".join(lines).encode()).digest()[:8], "big")
    notes = (
        ()
        if _is_one(frames[6])
        else (f"the flange stands {_said(frames[6])} behind the last joint: put it in the tool",)
    )
    return {".yaml": "\n".join([*lines, f"  hash: calib_{number}", ""])}, notes


def _moved(frames: list[Transform]) -> list[Transform]:
    """The same chain, the last frame moved along and about its axis to stand as near to the flange as may be."""
    end = pose(frames[-1])
    carried = transform(np.array([0, 0, end[2], end[3], 0, 0]))
    return [*frames[:-2], frames[-2] @ carried, np.linalg.solve(carried, frames[-1])]


def _is_one(T: Transform) -> bool:
    return bool(np.abs(T - np.eye(4)).max() < LOST)


def _said(T: Transform) -> str:
    values = pose(T) * np.array([1, 1, 1, *[180 / np.pi] * 3])
    names = ("x_mm", "y_mm", "z_mm", "rz_deg", "ry_deg", "rx_deg")
    return ", ".join(f"{name} {value:.4f}" for name, value in zip(names, values, strict=True))


def read(files: Mapping[str, str], calibration: Calibration) -> Forward:
    """jig_T_tip by the six origins, with the base and the tool of the calibration, which the format does not hold."""
    entries = YAML(typ="safe").load(files[".yaml"])["kinematics"]
    order = [float(entries[name][key]) for name in NAMES for key in KEYS]
    rows = np.array(order).reshape(6, 6)[:, [0, 1, 2, 5, 4, 3]] * np.array([METRE] * 3 + [1.0] * 3)
    base, tool = transform(calibration.theta[:6]), transform(calibration.theta[-6:])

    def tip(q: Float[np.ndarray, "poses joints"]) -> Float[np.ndarray, "poses 4 4"]:
        return base @ forward([*transform(rows), np.eye(4)], (False,) * 6, q) @ tool

    return tip


FORMAT = Format(".yaml", write, read)
