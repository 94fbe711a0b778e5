"""The paper's kinematics and closed-form error propagation (equations 1 to 41) in plain NumPy and SciPy.

Written from the equations alone, one elementary motion after another, to judge the symbolic code; no line is shared.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from identify.model.robot import Robot


@dataclass(frozen=True)
class Motion:
    """A turn about ("R") or a shift along ("T") one axis, or a constant transform ("C"); `carries` is the parameter."""

    kind: str
    axis: int
    matrix: np.ndarray
    carries: int | None


def _turn(axis: int, angle: float, carries: int) -> Motion:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix()
    return Motion("R", axis, T, carries)


def _shift(axis: int, length: float, carries: int) -> Motion:
    T = np.eye(4)
    T[axis, 3] = length
    return Motion("T", axis, T, carries)


def _frame(theta: np.ndarray, first: int) -> Iterator[Motion]:
    """Trans(x, y, z) Rz Ry Rx (equations 2 and 5)."""
    for k in range(3):
        yield _shift(k, theta[first + k], first + k)
    for k, axis in enumerate((2, 1, 0)):
        yield _turn(axis, theta[first + 3 + k], first + 3 + k)


def _link(robot: Robot, i: int, q: np.ndarray, theta: np.ndarray) -> Iterator[Motion]:
    """Rz(theta) Trans(a, 0, d) Rx(alpha) Ry(beta) (equation 4)."""
    first = 6 + 5 * i
    turn, d, a, alpha, beta = theta[first : first + 5]
    if robot.joints[i].prismatic:
        d = d + q[i]
    else:
        turn = turn + q[i]
    yield _turn(2, turn, first)
    yield _shift(2, d, first + 1)
    yield _shift(0, a, first + 2)
    yield _turn(0, alpha, first + 3)
    yield _turn(1, beta, first + 4)


def motions(robot: Robot, q: np.ndarray, theta: np.ndarray) -> list[Motion]:
    """Every elementary motion from the jig to the tip, in order (equation 1)."""
    chain = [*_frame(theta, 0), Motion("C", 0, robot.base_T_first, None)]
    for i in range(len(robot.joints)):
        chain += _link(robot, i, q, theta)
    return [*chain, Motion("C", 0, robot.last_T_flange, None), *_frame(theta, 6 + 5 * len(robot.joints))]


def forward(robot: Robot, q: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """jig_T_tip as a 4 x 4 matrix."""
    T = np.eye(4)
    for motion in motions(robot, q, theta):
        T = T @ motion.matrix
    return T


def error_propagation(robot: Robot, q: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """The 3 x P matrix of equations (6) to (41): tip displacement in the jig frame per unit of each parameter."""
    chain = motions(robot, q, theta)
    columns = np.zeros((3, theta.size))
    U = np.eye(4)
    for motion in reversed(chain):  # U: everything to the right of this motion
        n, o, a, p = U[:3, 0], U[:3, 1], U[:3, 2], U[:3, 3]
        k = motion.axis
        if motion.kind == "R":
            columns[:, motion.carries] = [np.cross(p, n)[k], np.cross(p, o)[k], np.cross(p, a)[k]]
        elif motion.kind == "T":
            columns[:, motion.carries] = [n[k], o[k], a[k]]
        U = motion.matrix @ U
    jig_R_tip = U[:3, :3]
    return jig_R_tip @ columns
