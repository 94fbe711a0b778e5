"""What each way of applying a calibration gives on this robot: the accuracy ladder."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.compensation.compensate import believed
from identify.compensation.fitting import fitted
from identify.model.files import InputError
from identify.model.io.calibration_file import Calibration, Errors, summarize
from identify.model.robot import POSE_NAMES, Robot
from identify.model.zone import zone_poses

DRAWS = 200  # robots that the covariance leaves possible
TIP = ((0.0, 0.0, 0.0),)  # where the fits are judged: at the tip, without levers beside it

ZEROS = "joint zeros"
TOOL = "zeros and tool"
FRAMES = "zeros, tool and base frame"
MODEL = "corrected programs, full model"
WAYS = {"nothing": (), ZEROS: ("zeros",), TOOL: ("zeros", "tool"), FRAMES: ("zeros", "tool", "base")}
"""What is entered into the controller; MODEL, which leaves only what the calibration does not know, comes last."""


@dataclass(frozen=True)
class Rung:
    """One way to apply a calibration, and the tip errors in the zone to expect of it."""

    way: str
    errors: Errors  # of a prediction: mean and 95 % over poses and possible robots, the largest at the worst pose


def ladder(calibration: Calibration) -> tuple[Rung, ...]:
    """The rungs from nothing to the full model, predicted; none where there is no zone that is reached.

    The identified parameters are taken for the truth, give or take their covariance. Each rung gets the best values
    that there are for what it may change, in the zone: least squares over its poses, not a part of the full fit.
    """
    cell = calibration.cell
    try:
        q = zone_poses(cell, calibration.theta)
    except InputError:
        return ()
    p, J = cell.kinematics.tip_jacobian(q, calibration.theta)
    value, vector = np.linalg.eigh(calibration.covariance)
    draws = (vector * np.sqrt(np.maximum(value, 0.0))) @ np.random.default_rng(0).standard_normal((len(value), DRAWS))
    unknown = np.einsum("pik,kd->pdi", J[:, :, calibration.index], draws, optimize=True)
    start, rungs = believed(calibration), list[Rung]()
    for way, groups in WAYS.items():
        names = [name for group in groups for name in _parameters(cell.robot, group)]
        start = fitted(calibration, names, start, q, TIP) if names else start
        off = p - cell.kinematics.tip(q, start)[0]
        rungs.append(Rung(way, _errors(off[:, None] + unknown)))
    return (*rungs, Rung(MODEL, _errors(unknown)))


def _parameters(robot: Robot, group: str) -> list[str]:
    """The parameters of a group that a controller takes."""
    if group == "zeros":
        return [f"{joint.name}.{'d' if joint.prismatic else 'theta'}" for joint in robot.joints]
    return [f"{group}.{name}" for name in POSE_NAMES]


def _errors(off: Float[np.ndarray, "poses draws 3"]) -> Errors:
    """Errors over poses and possible robots; the largest is the mean over robots of the largest over poses."""
    distance = np.linalg.norm(off, axis=2)
    e = summarize(distance.ravel())
    return Errors(len(distance), e.mean_mm, e.rms_mm, e.p95_mm, float(distance.max(axis=0).mean()))
