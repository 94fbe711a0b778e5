"""Inverse kinematics within joint limits for targets that no step downhill reaches: a small NLP each, by Ipopt."""

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from identify.model.ik_step import LEVER
from identify.model.kinematics import jig_T_tip, symbols
from identify.model.robot import Robot


def solve(
    robot: Robot,
    theta: Float[np.ndarray, " parameters"],
    position: Float[np.ndarray, "targets 3"],
    rotation: Float[np.ndarray, "targets 3 3"],
    near: Float[np.ndarray, "targets joints"],
    free_roll: bool,
) -> Float[np.ndarray, "targets joints"]:
    """Joint values within limits whose tip is at poses in the jig frame, as near to `near` as that allows.

    Where there are none, what Ipopt came to: the caller looks how far off it is.
    """
    solver = _solver(robot, free_roll)
    span = np.where(robot.prismatic, LEVER, 1.0)
    lower, upper = robot.lower / span, robot.upper / span
    solution = np.empty_like(near)
    for i, start in enumerate(near):
        values = np.concatenate([theta, position[i], rotation[i].ravel(), start / span])
        solution[i] = solver(x0=start / span, p=values, lbx=lower, ubx=upper, lbg=0, ubg=0)["x"].full().ravel() * span
    return solution


@lru_cache(maxsize=8)
def _solver(robot: Robot, free_roll: bool) -> ca.Function:
    """solver:(x0[N],p)->(x[N]): the shortest way to the pose; a sliding joint counts LEVER millimetres as a radian."""
    q, theta = symbols(robot)
    x, position, target = ca.SX.sym("x", q.numel()), ca.SX.sym("position", 3), ca.SX.sym("rotation", 9)
    near = ca.SX.sym("near", q.numel())
    span = ca.SX([LEVER if prismatic else 1.0 for prismatic in robot.prismatic])
    T = ca.substitute(jig_T_tip(robot, q, theta, ca.SX.eye(4)[:3, :], ca.SX([[0, 0, 0, 1]])), q, x * span)
    R = T[:, :3].T @ ca.reshape(target, 3, 3).T
    # which half turn is meant is settled by the start, which is near
    turn = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    turn = ca.vertcat(R[0, 2], R[1, 2]) if free_roll else turn
    problem: dict[str, Any] = {
        "x": x,
        "p": ca.vertcat(theta, position, target, near),
        "f": ca.sumsqr(x - near),
        "g": ca.vertcat((T[:, 3] - position) / LEVER, turn),
    }
    quiet: dict[str, Any] = {
        "print_level": 0,
        "sb": "yes",
        "max_iter": 20,
        "bound_relax_factor": 0.0,
        "tol": 1e-10,
        "acceptable_tol": 1e-9,
    }
    options: dict[str, Any] = {"ipopt": quiet, "print_time": False, "error_on_fail": False}
    return ca.nlpsol("solver", "ipopt", problem, options)
