"""Inverse kinematics of any robot, calibrated or not, for all targets at once."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from identify.model.ik_step import AXIS, LEVER, POINT, POSE, descent
from identify.model.kinematics import Kinematics
from identify.model.robot import Robot

STEP = 0.8  # [rad], longest step of a revolute joint; LEVER times that for a prismatic one
DAMPING = 1e-2  # of the cost: none is left when the target is near, and convergence is quadratic (Fan and Yuan 2005)
FLOOR = 1e-10 * LEVER**2  # damping at singular postures [mm^2]
PATIENCE = 4  # steps in a row that do not shorten the way by SLOW, before a target is given up
SLOW = 0.02
EDGE = 1e-9  # [rad] or [mm], rounding at a joint limit


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
    free_orientation: bool = False,
    iterations: int = 40,
    tolerance: float = 1e-6,
) -> Reach:
    """Joint values that bring the tip to poses in the jig frame, near to a start (Levenberg-Marquardt, batched).

    With `free_roll` the turn about the wire, z of the tip, is left open; with `free_orientation` all turns are. Stops
    at `tolerance` [mm], and earlier where no step leads nearer.
    """
    rows = POINT if free_orientation else AXIS if free_roll else POSE
    task = _Task(kinematics, theta, position, rotation.reshape(len(rotation), 9), rows)
    q, cost = _descend(task, start.astype(float), iterations, tolerance**2)
    q = wrapped(kinematics, q)
    robot = kinematics.robot
    return Reach(q, np.sqrt(cost), within(robot, q))


def within(robot: Robot, q: Float[np.ndarray, "*rows joints"]) -> Bool[np.ndarray, "*rows"]:
    """Whether all joints stand within their limits."""
    return np.asarray(((q >= robot.lower - EDGE) & (q <= robot.upper + EDGE)).all(axis=-1))


def wrapped(kinematics: Kinematics, q: Float[np.ndarray, "targets joints"]) -> Float[np.ndarray, "targets joints"]:
    """Revolute joints turned by whole turns to lie within their limits, or nearest to the middle of them."""
    robot = kinematics.robot
    turn = 2 * np.pi
    middle = (robot.lower + robot.upper) / 2
    centred = q - turn * np.round((q - middle) / turn)
    keep = (q >= robot.lower) & (q <= robot.upper)
    return np.where(np.array(robot.prismatic) | keep, q, centred)


@dataclass(frozen=True, eq=False)
class _Task:
    """What is asked of the tip."""

    kinematics: Kinematics
    theta: Float[np.ndarray, " parameters"]
    position: Float[np.ndarray, "targets 3"]
    rotation: Float[np.ndarray, "targets 9"]
    rows: int

    def step(
        self, q: Float[np.ndarray, "some joints"], which: np.ndarray, damping: Float[np.ndarray, " some"]
    ) -> tuple[Float[np.ndarray, "some joints"], Float[np.ndarray, " some"]]:
        """The next step [rad] or [LEVER mm], and the square of the way that is left [mm^2]."""
        f = descent(self.kinematics.robot, self.rows)
        step, cost = f(q, self.theta, self.position[which], self.rotation[which], np.maximum(damping, FLOOR)[:, None])
        return step.reshape(q.shape), cost  # one joint is a vector there, too


def _descend(
    task: _Task, start: Float[np.ndarray, "targets joints"], iterations: int, enough: float
) -> tuple[Float[np.ndarray, "targets joints"], Float[np.ndarray, " targets"]]:
    """Joint values and costs after damped steps, each shortened until it leads downhill: one evaluation each."""
    q, active = start.copy(), np.arange(len(start))
    span = np.where(task.kinematics.robot.prismatic, LEVER, 1.0)
    step, cost = task.step(q, active, np.full(len(q), DAMPING * LEVER**2))
    x, c, length, slow = q.copy(), cost.copy(), np.ones(len(q)), np.zeros(len(q), dtype=int)
    for _ in range(iterations):
        on = (c > enough) & (slow < PATIENCE)
        if not on.all():
            q[active], cost[active] = x, c
            active, x, c, step, length, slow = active[on], x[on], c[on], step[on], length[on], slow[on]
        if not len(active):
            break
        shortened = length * np.minimum(1, STEP / np.maximum(np.abs(step).max(axis=1), 1e-300))
        trial = x + shortened[:, None] * step * span
        next_step, next_cost = task.step(trial, active, DAMPING * c)
        better = next_cost < c
        slow = np.where(next_cost < (1 - SLOW) * c, 0, slow + 1)
        x, step = np.where(better[:, None], trial, x), np.where(better[:, None], next_step, step)
        c, length = np.where(better, next_cost, c), np.where(better, np.minimum(1, 4 * length), length / 4)
    q[active], cost[active] = x, c
    return q, cost
