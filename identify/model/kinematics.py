"""Equations (1) to (5) in CasADi symbols, and the functions compiled from them."""

from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from identify.model.compiled.batch import Mapped, compiled
from identify.model.joint_error_models import Deflected, deflected
from identify.model.robot import Robot


def _rz(angle: ca.SX, M: ca.SX) -> ca.SX:
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(c * M[0, :] - s * M[1, :], s * M[0, :] + c * M[1, :], M[2, :])


def _ry(angle: ca.SX, M: ca.SX) -> ca.SX:
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(c * M[0, :] + s * M[2, :], M[1, :], c * M[2, :] - s * M[0, :])


def _rx(angle: ca.SX, M: ca.SX) -> ca.SX:
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(M[0, :], c * M[1, :] - s * M[2, :], s * M[1, :] + c * M[2, :])


def _frame(pose: ca.SX, M: ca.SX, w: ca.SX) -> ca.SX:
    """Trans(x, y, z) Rz Ry Rx applied to the columns of M (equations 2 and 5)."""
    return pose[:3] @ w + _rz(pose[3], _ry(pose[4], _rx(pose[5], M)))


def _constant(T: np.ndarray, M: ca.SX, w: ca.SX) -> ca.SX:
    return M if np.array_equal(T, np.eye(4)) else ca.SX(T[:3, :3]) @ M + ca.SX(T[:3, 3]) @ w


def _link(robot: Robot, i: int, q: ca.SX, theta: ca.SX, M: ca.SX, w: ca.SX) -> ca.SX:
    """Columns of M carried from the frame of link i + 1 to that of link i (equation 4)."""
    offset, d, a, alpha, beta = ca.vertsplit(theta[6 + 5 * i : 11 + 5 * i])
    turn, slide = (offset, d + q[i]) if robot.prismatic[i] else (offset + q[i], d)
    return _rz(turn, ca.vertcat(a, 0, slide) @ w + _rx(alpha, _ry(beta, M)))


def _stand(robot: Robot, true: Deflected, M: ca.SX, w: ca.SX) -> ca.SX:
    """Columns of M carried from before the first joint to the base, which gives way where it has a tilt."""
    M = _constant(robot.base_T_first, M, w)
    return M if true.tilt is None else _rz(true.tilt[2], _ry(true.tilt[1], _rx(true.tilt[0], M)))


def base_T_flange(robot: Robot, true: Deflected, M: ca.SX, w: ca.SX) -> ca.SX:
    """Columns of M carried from the flange to the base by A_1 ... A_N (equations 3 and 4)."""
    M = _constant(robot.last_T_flange, M, w)
    for i in reversed(range(len(robot.joints))):
        M = _link(robot, i, true.q, true.theta, M, w)
    return _stand(robot, true, M, w)


def jig_T_tip(robot: Robot, q: ca.SX, theta: ca.SX, M: ca.SX, w: ca.SX, conditions: ca.SX | None = None) -> ca.SX:
    """Columns of M carried from the tip to the jig frame (equation 1); w is 1 above a point, 0 above a direction.

    `made` are the conditions of a touch, for error models that depend on them.

    Points and directions travel through the chain as columns, from the tip back: half the operations of a product
    of matrices, and derivatives in reverse cost as little.
    """
    true = deflected(robot, q, theta, conditions)
    return _frame(theta[:6], base_T_flange(robot, true, _frame(theta[-6:], M, w), w), w)


def jig_T_tip_and_twists(robot: Robot, q: ca.SX, theta: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The tip in the jig frame (3 x 4), and velocity above spin of the tip per unit of each joint, in the tip's frame.

    On the way from the tip back to the jig every joint sees the tip from its own frame, where its axis is z: the
    geometric Jacobian (Whitney 1972) costs nine operations a joint.
    """
    w = ca.SX([[0, 0, 0, 1]])
    true = deflected(robot, q, theta)
    M = _constant(robot.last_T_flange, _frame(theta[-6:], ca.SX.eye(4)[:3, :], w), w)
    twists = []
    for i in reversed(range(len(robot.joints))):
        M = _link(robot, i, true.q, true.theta, M, w)
        R, p = M[:, :3], M[:, 3]
        turning = ca.vertcat(p[0] * R[1, :].T - p[1] * R[0, :].T, R[2, :].T)
        twists.append(ca.vertcat(R[2, :].T, ca.SX(3, 1)) if robot.prismatic[i] else turning)
    J = ca.horzcat(*reversed(twists))
    if robot.errors:
        J = J @ ca.jacobian(true.q, q) + _tilting(true, q, _constant(robot.base_T_first, M, w))
    return _frame(theta[:6], _stand(robot, true, M, w), w), J


def _tilting(true: Deflected, q: ca.SX, base_T_tip: ca.SX) -> ca.SX:
    """What the tilt of the base, a small angle, adds to the twists of the tip."""
    if true.tilt is None:
        return ca.SX(6, q.shape[0])
    R, p, spin = base_T_tip[:, :3], base_T_tip[:, 3], ca.jacobian(true.tilt, q)
    return ca.vertcat(R.T @ -ca.skew(p) @ spin, R.T @ spin)


def symbols(robot: Robot) -> tuple[ca.SX, ca.SX]:
    """Joint values and parameters of a robot, as symbols."""
    return ca.SX.sym("q", len(robot.joints)), ca.SX.sym("theta", len(robot.parameters))


POINT, AXIS = ca.SX([0, 0, 0]), ca.SX([0, 0, 1])
ONE, ZERO = ca.SX(1), ca.SX(1, 1)  # the second is structurally zero: nothing is added to a direction


class Kinematics:
    """Forward kinematics of a robot and its derivatives, each compiled when first asked for."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.q, self.theta = symbols(robot)

    @cached_property
    def _tip(self) -> ca.SX:
        return jig_T_tip(self.robot, self.q, self.theta, ca.SX.eye(4)[:3, :], ca.SX([[0, 0, 0, 1]]))

    def _compiled(self, name: str, outputs: dict[str, ca.SX]) -> Mapped:
        return compiled(name, {"q": self.q, "theta": self.theta}, outputs)

    @cached_property
    def tip(self) -> Mapped:
        """tip:(q[N],theta[P])->(position[3],rotation[3x3]), in the jig frame."""
        return self._compiled("tip", {"position": self._tip[:, 3], "rotation": self._tip[:, :3]})

    @cached_property
    def tip_jacobian(self) -> Mapped:
        """tip_jacobian:(q[N],theta[P])->(position[3],J[3xP]), J = d position / d theta."""
        p = jig_T_tip(self.robot, self.q, self.theta, POINT, ONE)
        return self._compiled("tip_jacobian", {"position": p, "J": ca.jacobian(p, self.theta)})

    @cached_property
    def pose_jacobian(self) -> Mapped:
        """pose_jacobian:(q[N],theta[P])->(position[3],rotation[3x3],J[6xN]): velocity and spin of the tip."""
        T, twists = jig_T_tip_and_twists(self.robot, self.q, self.theta)
        p, R = T[:, 3], T[:, :3]
        J = ca.vertcat(R @ twists[:3, :], R @ twists[3:, :])
        return self._compiled("pose_jacobian", {"position": p, "rotation": R, "J": J})

    @cached_property
    def flange(self) -> Mapped:
        """flange:(q[N],theta[P])->(position[3],rotation[3x3]), in the base frame, as a pendant shows."""
        true = deflected(self.robot, self.q, self.theta)
        T = base_T_flange(self.robot, true, ca.SX.eye(4)[:3, :], ca.SX([[0, 0, 0, 1]]))
        return self._compiled("flange", {"position": T[:, 3], "rotation": T[:, :3]})

    @cached_property
    def links(self) -> Mapped:
        """links:(q[N],theta[P])->(T0[3x4], ..., TN[3x4]): frames 0 (base) to N of the links, in the jig frame."""
        M, w = ca.SX.eye(4)[:3, :], ca.SX([[0, 0, 0, 1]])
        true = deflected(self.robot, self.q, self.theta)
        T = _frame(self.theta[:6], _stand(self.robot, true, M, w), w)
        outputs = {"T0": T}
        for i in range(len(self.robot.joints)):
            T = T[:, :3] @ _link(self.robot, i, true.q, true.theta, M, w) + T[:, 3] @ w
            outputs[f"T{i + 1}"] = T
        return self._compiled("links", outputs)


@lru_cache(maxsize=32)
def shared_kinematics(robot: Robot) -> Kinematics:
    """The kinematics of a robot, compiled once for all cells in which it stands."""
    return Kinematics(robot)
