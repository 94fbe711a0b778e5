"""Which corrections to trust: what leaves a target alone, and the words for it."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from identify.model.ik import Reach
from identify.model.ik_step import LEVER
from identify.model.kinematics import Kinematics
from identify.model.robot import Robot

RESIDUAL = 1e-3  # [mm], of inverse kinematics, orientation counted with LEVER
SINGULAR = 0.1  # smallest singular value of the pose Jacobian, lengths in LEVER; nearer to a singularity it is smaller


def reasons(
    kinematics: Kinematics,
    theta: Float[np.ndarray, " parameters"],
    before: Float[np.ndarray, "targets joints"],
    reached: Reach,
    limit: float,
) -> Iterator[tuple[int, str]]:
    """Targets whose correction is not to be trusted, and why; `limit` is the largest change of a joint [rad].

    Targets that had no solution before are not judged.
    """
    robot = kinematics.robot
    change = joint_change(robot, before, reached.q)
    around = turned_around(robot, before, reached.q)
    good = (reached.residual < RESIDUAL) & reached.within_limits & ~around.any(axis=1) & (change.max(axis=1) < limit)
    unreached = np.flatnonzero(~good & ~np.isnan(before[:, 0]))
    for i, singular in zip(unreached.tolist(), smallest(kinematics, theta, before[unreached]) < SINGULAR, strict=True):
        if not reached.residual[i] < RESIDUAL:
            what = "near a singularity" if singular else "out of reach"
            yield i, f"{what}: the identified robot comes no nearer than {reached.residual[i]:.3g} mm"
        elif around[i].any():
            name = robot.joints[int(np.argmax(around[i]))].name
            yield i, f"joint limit: {name} would pass it and have to turn all the way back"
        elif not reached.within_limits[i]:
            yield i, f"joint limit: {_beyond(robot, reached.q[i])}"
        else:
            what = "near a singularity" if singular else "large joint change"
            yield i, f"{what}: {_moved(robot, change[i], limit)}"


def joint_change(
    robot: Robot, before: Float[np.ndarray, "targets joints"], after: Float[np.ndarray, "targets joints"]
) -> Float[np.ndarray, "targets joints"]:
    """Sizes of joint changes [rad], whole turns apart; LEVER makes an angle of a length."""
    change = after - before
    turn = change - 2 * np.pi * np.round(change / (2 * np.pi))
    return np.abs(np.where(robot.prismatic, change / LEVER, turn))


def turned_around(
    robot: Robot, before: Float[np.ndarray, "targets joints"], after: Float[np.ndarray, "targets joints"]
) -> Bool[np.ndarray, "targets joints"]:
    """Joints that could not go on past their limit, and would have to turn all the way back."""
    return (np.abs(after - before) > np.pi) & ~np.array(robot.prismatic)


def smallest(
    kinematics: Kinematics, theta: Float[np.ndarray, " parameters"], q: Float[np.ndarray, "poses joints"]
) -> Float[np.ndarray, " poses"]:
    """The smallest singular values of the pose Jacobian, lengths in LEVER: 0 at a singularity."""
    J = kinematics.pose_jacobian(q, theta)[2]
    lengths = np.array([1 / LEVER] * 3 + [1.0] * 3)[:, None]
    scaled = J * lengths * np.where(kinematics.robot.prismatic, LEVER, 1.0)
    return np.linalg.svd(scaled, compute_uv=False)[:, -1]


def _beyond(robot: Robot, q: Float[np.ndarray, " joints"]) -> str:
    """The joint furthest beyond its limits."""
    j = int(np.argmax(np.maximum(robot.lower - q, q - robot.upper)))
    unit = robot.joint_unit()[j]
    limit = robot.lower[j] if q[j] < robot.lower[j] else robot.upper[j]
    return f"{robot.joints[j].name} would stand at {q[j] / unit:.2f}, its limit is {limit / unit:g}"


def _moved(robot: Robot, change: Float[np.ndarray, " joints"], limit: float) -> str:
    """The joint that would move furthest."""
    j = int(np.argmax(change))
    factor, unit = (LEVER, "mm") if robot.prismatic[j] else (180 / np.pi, "degrees")
    return f"{robot.joints[j].name} would move by {change[j] * factor:.3g} {unit}, allowed {limit * factor:.3g}"
