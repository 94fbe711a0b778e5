"""What may have changed since a robot was identified: single parameters, and parts that a hit or a slip moves."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from identify.model.cell import DEG
from identify.model.frames import rotation
from identify.model.io.calibration_file import Calibration

SLIP = (0.5, 0.3 * DEG)  # [mm], [rad]: 1 sigma of how far a joint zero slips
KNOCK = 3.0  # [mm]: of how far a tool, a wire's end or a base is knocked
TILT = 0.3 * DEG  # of a base
SHARE = 0.3  # of its tolerance, that another parameter may drift
SELDOM = 0.02  # how often that happens beside a slip or a knock: castings keep their shape

Kind = Literal["zero", "tool", "wire", "base", "parameter"]


@dataclass(frozen=True, eq=False)
class Cause:
    """One thing that may have happened: directions in which parameters change, and how far is usual."""

    name: str
    kind: Kind
    directions: Float[np.ndarray, "parameters freedoms"]  # [mm] or [rad] a unit
    size: Float[np.ndarray, " freedoms"]  # 1 sigma [mm] or [rad]
    weight: float = 1.0  # how often it happens, beside the others


def causes(calibration: Calibration) -> list[Cause]:
    """Everything that is looked for, what happens more often first."""
    robot, theta = calibration.cell.robot, calibration.theta
    names = robot.parameters
    unit = np.eye(len(names))
    zeros = zero_names(calibration)
    tool, base = [names.index(f"tool.{axis}") for axis in "xyz"], list(range(6))
    wire = unit[:, tool] @ rotation(theta[-3], theta[-2], theta[-1])[:, 2:]
    causes = [
        Cause("tool", "tool", unit[:, tool], np.full(3, KNOCK)),
        Cause("wire", "wire", wire, np.array([KNOCK])),
        *(Cause(name, "zero", unit[:, [names.index(name)]], np.array([size])) for name, size in zeros.items()),
        Cause("base", "base", unit[:, base], np.array([KNOCK] * 3 + [TILT] * 3)),
    ]
    parts = {"base", "tool"}
    causes += [
        Cause(name, "parameter", unit[:, [i]], SHARE * calibration.cell.scale[[i]], SELDOM)
        for i, name in zip(calibration.index, calibration.estimated, strict=True)
        if name not in zeros and name.split(".")[0] not in parts
    ]
    return causes


def zero_names(calibration: Calibration) -> dict[str, float]:
    """The zeros of the joints, and how far they slip [mm] or [rad]."""
    joints = calibration.cell.robot.joints
    return {
        f"{joint.name}.{'d' if joint.prismatic else 'theta'}": SLIP[0 if joint.prismatic else 1] for joint in joints
    }


def looked_for(calibration: Calibration) -> dict[str, float]:
    """Parameters that slips and knocks move, and how far: what touches of a health check have to tell apart."""
    frames = {f"base.{axis}": KNOCK for axis in "xyz"} | {f"base.{axis}": TILT for axis in ("rz", "ry", "rx")}
    return zero_names(calibration) | frames | {f"tool.{axis}": KNOCK for axis in "xyz"}
