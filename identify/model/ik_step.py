"""One damped step of inverse kinematics as a compiled function: pose wanted in, joint step and what is left out."""

from functools import lru_cache

import casadi as ca

from identify.model.compiled.batch import Mapped, compiled
from identify.model.kinematics import jig_T_tip_and_twists, symbols
from identify.model.robot import Robot

LEVER = 300.0  # [mm] a radian of orientation counts as much as this way of the tip
POSE, AXIS, POINT = 6, 5, 3  # rows of the task: everything, without the turn about the wire, the position alone


@lru_cache(maxsize=16)
def descent(robot: Robot, rows: int) -> Mapped:
    """descent:(q[N],theta[P],position[3],rotation[9],damping)->(step[N],cost): a step of Levenberg and Marquardt.

    `rotation` is jig_R_tip row by row, `cost` the square of the way left [mm^2], `step` in radians or LEVER mm.
    More joints than rows: the shortest step that does it (Wampler 1986).
    """
    q, theta = symbols(robot)
    position, target, damping = ca.SX.sym("position", 3), ca.SX.sym("rotation", 9), ca.SX.sym("damping")
    T, twists = jig_T_tip_and_twists(robot, q, theta)
    R = T[:, :3]
    turn, angle = _turn(R.T @ ca.reshape(target, 3, 3).T, rows)
    way = ca.vertcat(R.T @ (position - T[:, 3]), LEVER * turn)[:rows]
    span = ca.diag(ca.SX([LEVER if prismatic else 1.0 for prismatic in robot.prismatic]))
    J = (ca.vertcat(twists[:3, :], LEVER * twists[3:, :]) @ span)[:rows, :]
    wide = len(robot.joints) > rows
    step = J.T @ solved(J @ J.T, way, damping) if wide else solved(J.T @ J, J.T @ way, damping)
    cost = ca.sumsqr(way[:3]) + (LEVER * angle) ** 2
    inputs = {"q": q, "theta": theta, "position": position, "rotation": target, "damping": damping}
    return compiled("descent", inputs, {"step": step, "cost": cost})


def _turn(R: ca.SX, rows: int) -> tuple[ca.SX, ca.SX]:
    """The rotation vector of R [rad], or the shortest one that takes z along with R, and its length.

    The length is taken on its own: next to half a turn the vector loses its direction, but not the length.
    """
    if rows == POINT:
        return ca.SX(3, 1), ca.SX(0)
    if rows == AXIS:
        v, cosine = ca.vertcat(-R[1, 2], R[0, 2], 0), R[2, 2]
    else:
        v = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
        cosine = (ca.trace(R) - 1) / 2
    sine = ca.sqrt(ca.sumsqr(v) + 1e-30)
    angle = ca.atan2(sine, cosine)
    return v * (angle / sine), angle


def solved(A: ca.SX, b: ca.SX, damping: ca.SX) -> ca.SX:
    """(A + damping)^-1 b for a symmetric A by Cholesky, of which only the lower half is read."""
    n = b.numel()
    L = [[ca.SX(0)] * n for _ in range(n)]
    pivot: list[ca.SX] = []
    y: list[ca.SX] = []
    for i in range(n):
        for j in range(i):
            L[i][j] = (A[i, j] - sum(L[i][k] * L[j][k] for k in range(j))) * pivot[j]
        pivot.append(1 / ca.sqrt(A[i, i] + damping - sum(L[i][k] ** 2 for k in range(i))))
        y.append((b[i] - sum(L[i][k] * y[k] for k in range(i))) * pivot[i])
    x = list(y)
    for i in reversed(range(n)):
        x[i] = (y[i] - sum(L[k][i] * x[k] for k in range(i + 1, n))) * pivot[i]
    return ca.vertcat(*x)
