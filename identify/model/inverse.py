"""Inverse kinematics of any robot, calibrated or not, for all targets at once."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from identify.model.kinematics import Kinematics

LEVER = 300.0  # [mm] a radian of orientation counts as much as this way of the tip
STEP = 0.4  # [rad], longest step of a revolute joint; LEVER times that for a prismatic one


@dataclass(frozen=True, eq=False)
class Reach:
    """Joint values for targets, and how well they reach them."""

    q: Float[np.ndarray, "targets joints"]  # [rad] or [mm], within the limits where a whole turn can bring them there
    residual: Float[np.ndarray, " targets"]  # [mm], orientation errors counted with LEVER
    within_limits: Bool[np.ndarray, " targets"]

    def reached(self, tolerance: float = 1e-4) -> Bool[np.ndarray, " targets"]:
        """Targets met within a tolerance [mm] and within the joint limits."""
        return self.within_limits & (self.residual < tolerance)


def reach(
    kinematics: Kinematics,
    theta: Float[np.ndarray, " parameters"],
    position: Float[np.ndarray, "targets 3"],
    rotation: Float[np.ndarray, "targets 3 3"],
    start: Float[np.ndarray, "targets joints"],
    *,
    free_roll: bool = False,
    iterations: int = 40,
    tolerance: float = 1e-6,
) -> Reach:
    """Joint values that bring the tip to poses in the jig frame, nearest to a start (Levenberg-Marquardt, batched).

    With `free_roll` the turn about the wire, z of the tip, is left open. Stops at `tolerance` [mm].
    """
    task = _Task(kinematics, theta, position, rotation, free_roll)
    span = np.where(kinematics.robot.prismatic, LEVER, 1.0)
    q = start.astype(float).copy()
    error, J = task.error(q, slice(None))
    cost = (error**2).sum(axis=1)
    damping = np.full(len(q), 1e-3)
    active = np.flatnonzero(cost > tolerance**2)
    for _ in range(iterations):
        if not len(active):
            break
        step = _step(J[active] * span, error[active], damping[active]) * span
        trial = q[active] + step * np.minimum(1, STEP / np.maximum(np.abs(step / span).max(axis=1), 1e-12))[:, None]
        trial_error, trial_J = task.error(trial, active)
        trial_cost = (trial_error**2).sum(axis=1)
        better = trial_cost < cost[active]
        damping[active] = np.clip(np.where(better, damping[active] * 0.1, damping[active] * 10), 1e-12, 1e6)
        moved = active[better]
        q[moved], error[moved], J[moved], cost[moved] = (
            trial[better],
            trial_error[better],
            trial_J[better],
            trial_cost[better],
        )
        stuck = ~better & (np.abs(step / span).max(axis=1) < 1e-12)
        active = active[(cost[active] > tolerance**2) & ~stuck]
    q = wrapped(kinematics, q)
    robot = kinematics.robot
    inside = ((q >= robot.lower - 1e-9) & (q <= robot.upper + 1e-9)).all(axis=1)
    return Reach(q, np.sqrt(cost), inside)


def wrapped(kinematics: Kinematics, q: Float[np.ndarray, "targets joints"]) -> Float[np.ndarray, "targets joints"]:
    """Revolute joints turned by whole turns to lie within their limits, or nearest to the middle of them."""
    robot = kinematics.robot
    turn = 2 * np.pi
    middle = (robot.lower + robot.upper) / 2
    centred = q - turn * np.round((q - middle) / turn)
    keep = (q >= robot.lower) & (q <= robot.upper)
    return np.where(np.array(robot.prismatic) | keep, q, centred)


def _step(
    J: Float[np.ndarray, "targets rows joints"],
    error: Float[np.ndarray, "targets rows"],
    damping: Float[np.ndarray, " targets"],
) -> Float[np.ndarray, "targets joints"]:
    """Damped least squares steps (Levenberg 1944; Wampler 1986)."""
    JtJ = J.transpose(0, 2, 1) @ J
    size = np.trace(JtJ, axis1=1, axis2=2) / J.shape[2]
    A = JtJ + (damping * size)[:, None, None] * np.eye(J.shape[2]) * 1e-3
    return np.linalg.solve(A, J.transpose(0, 2, 1) @ error[..., None])[..., 0]


@dataclass(frozen=True, eq=False)
class _Task:
    """What is asked of the tip, and how far it is from that."""

    kinematics: Kinematics
    theta: Float[np.ndarray, " parameters"]
    position: Float[np.ndarray, "targets 3"]
    rotation: Float[np.ndarray, "targets 3 3"]
    free_roll: bool

    def error(
        self, q: Float[np.ndarray, "some joints"], which: np.ndarray | slice
    ) -> tuple[Float[np.ndarray, "some rows"], Float[np.ndarray, "some rows joints"]]:
        """What is left of the way [mm], in the frame of the tip, and the Jacobian of what was made of it."""
        p, R, J = self.kinematics.pose_jacobian(q, self.theta)
        Rt = R.transpose(0, 2, 1)
        turn = _rotation_vector(Rt @ self.rotation[which])
        if self.free_roll:
            turn = _tilt_vector((Rt @ self.rotation[which])[:, :, 2])
        way = np.concatenate([(Rt @ (self.position[which] - p)[..., None])[..., 0], LEVER * turn], axis=1)
        J = np.concatenate([Rt @ J[:, :3], LEVER * Rt @ J[:, 3:]], axis=1)
        return (way[:, :5], J[:, :5]) if self.free_roll else (way, J)


def _rotation_vector(R: Float[np.ndarray, "some 3 3"]) -> Float[np.ndarray, "some 3"]:
    """Axis times angle of rotations [rad]."""
    v = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    sine = np.linalg.norm(v, axis=1)
    angle = np.arctan2(sine, (np.trace(R, axis1=1, axis2=2) - 1) / 2)
    return v * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)[:, None]


def _tilt_vector(axis: Float[np.ndarray, "some 3"]) -> Float[np.ndarray, "some 3"]:
    """The shortest rotation [rad] that brings z to an axis; it has no part about z."""
    v = np.stack([-axis[:, 1], axis[:, 0], np.zeros(len(axis))], axis=1)
    sine = np.linalg.norm(v, axis=1)
    angle = np.arctan2(sine, axis[:, 2])
    return v * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)[:, None]
