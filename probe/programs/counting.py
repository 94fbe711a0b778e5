"""How joints stand in programs and logs: as the controller counts them."""

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError
from identify.model.robot import Robot


def to_counts(robot: Robot, q: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows joints"]:
    """Joint values [rad] as the controller counts them [deg]."""
    return q / robot.joint_unit()


def from_counts(robot: Robot, counts: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows joints"]:
    """The inverse of `to_counts`."""
    return counts * robot.joint_unit()


def to_pulses(robot: Robot, q: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows joints"]:
    """Joint values [rad] as pulses, unrounded; raises InputError where those of a degree are not known."""
    return to_counts(robot, q) * _per_degree(robot)


def from_pulses(robot: Robot, pulses: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows joints"]:
    """The inverse of `to_pulses`."""
    return from_counts(robot, pulses / _per_degree(robot))


def _per_degree(robot: Robot) -> Float[np.ndarray, " joints"]:
    counting = getattr(robot, "counting", None)
    if counting is None:
        raise InputError("the pulses of a degree are not known; write joints: {pulses_per_deg: [...]} in cell.yaml")
    return np.asarray(counting.per_degree)
