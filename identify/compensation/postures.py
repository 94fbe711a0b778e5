"""Where a nominal robot stands for poses: solutions of inverse kinematics when nobody says where to start from."""

import numpy as np
from jaxtyping import Bool, Float

from identify.compensation.trust import joint_change, smallest
from identify.model.ik import reach
from identify.model.ik_step import LEVER
from identify.model.kinematics import Kinematics
from identify.model.robot import Robot

SEEDS = 400  # postures drawn to find one to start from
ROUNDS = 8  # of drawing, for targets that nothing else has reached
ITERATIONS = 30
SPREAD = 32  # targets to which a branch is followed, to choose it
ROOM = np.radians(3.0)  # [rad] within the joint limits, that a correction may need; LEVER times that in [mm]
BRANCHES = 100  # at the most
PIONEERS = 16  # of so many targets one is solved first, and the others start from the nearest of these


def nominal(
    kinematics: Kinematics,
    theta: Float[np.ndarray, " parameters"],
    T: Float[np.ndarray, "targets 4 4"],
    near: Float[np.ndarray, " joints"] | Float[np.ndarray, "targets joints"] | None = None,
) -> tuple[Float[np.ndarray, "targets joints"], Bool[np.ndarray, " targets"]]:
    """Joint values for poses jig_T_tip, within limits, and which poses are reached.

    Where there is a start `near` for each pose, there is no other. Else a few poses are solved from one posture, and
    the others from the nearest solution, so that a path keeps its posture; last come postures drawn at random, the
    same on every call.
    """
    tries = _Tries(kinematics, theta, T)
    if not len(T) or (near is not None and near.ndim == 2):
        tries.start(np.arange(len(T)), near)
        return tries.q, tries.reached
    first = posture(kinematics, theta, T) if near is None else near
    tries.start(np.arange(0, len(T), PIONEERS), first)
    while tries.start_from_neighbours(first):
        pass
    for round_ in range(ROUNDS):
        open_ = np.flatnonzero(~tries.reached)
        tries.start(open_, _draws(kinematics.robot, len(open_), round_ + 1))
    return tries.q, tries.reached


class _Tries:
    """Poses, and what was found for them so far."""

    def __init__(self, kinematics: Kinematics, theta: np.ndarray, T: np.ndarray) -> None:
        self.kinematics, self.theta, self.T = kinematics, theta, T
        self.q = np.empty((len(T), len(kinematics.robot.joints)))
        self.reached = np.zeros(len(T), dtype=bool)

    def start(self, these: np.ndarray, q: np.ndarray | None) -> None:
        """Try some poses from postures, one each or one for all."""
        if not len(these) or q is None:
            return
        p, R = self.T[these, :3, 3], self.T[these, :3, :3]
        begin = np.broadcast_to(q, (len(these), self.q.shape[1]))
        reached = reach(self.kinematics, self.theta, p, R, begin, iterations=ITERATIONS)
        got = reached.reached()
        self.q[these[got]], self.reached[these[got]] = reached.q[got], True

    def start_from_neighbours(self, first: np.ndarray) -> bool:
        """Try the open poses from the nearest pose that has a solution; whether that brought something new."""
        open_, solved = np.flatnonzero(~self.reached), np.flatnonzero(self.reached)
        if not len(open_):
            return False
        self.start(open_, self.q[solved[_nearest(self.T[solved], self.T[open_])]] if len(solved) else first)
        return int(self.reached.sum()) > len(solved)


def posture(
    kinematics: Kinematics, theta: Float[np.ndarray, " parameters"], T: Float[np.ndarray, "targets 4 4"]
) -> Float[np.ndarray, " joints"]:
    """One posture to reach many targets from: near the middle of the joints and of the targets, and not singular."""
    robot = kinematics.robot
    q = np.vstack([(robot.lower + robot.upper) / 2, _draws(robot, SEEDS, 0)])
    position, rotation = kinematics.tip(q, theta)
    middle = np.median(T[:, :3, 3], axis=0)
    turned = np.arccos(np.clip((np.einsum("ikl,kl->i", rotation, _middle_turn(T)) - 1) / 2, -1, 1))
    effort = np.abs(2 * (q - robot.lower) / (robot.upper - robot.lower) - 1).mean(axis=1)
    way = np.linalg.norm(position - middle, axis=1) / LEVER + turned + 2 * effort
    regular = smallest(kinematics, theta, q)
    return np.asarray(q[np.argmin(np.where(regular >= np.median(regular), way, np.inf))])


def regular_branch(
    kinematics: Kinematics, theta: Float[np.ndarray, " parameters"], T: Float[np.ndarray, "targets 4 4"]
) -> Float[np.ndarray, " joints"]:
    """One posture to reach all targets from: of the branch that reaches most of them and stays farthest from singular.

    Branches are the solutions for a target near the middle, from many starts; each is followed to targets spread over
    all. Of branches as regular as each other, the one nearest to the middle of the joints is taken.
    """
    robot = kinematics.robot
    middle = (robot.lower + robot.upper) / 2
    some = T[np.unique(np.linspace(0, len(T) - 1, SPREAD).astype(int))]
    inward = np.argsort(np.linalg.norm(some[:, :3, 3] - np.median(T[:, :3, 3], axis=0), axis=1), kind="stable")
    for k in inward.tolist():
        anchor = np.repeat(some[k : k + 1], SEEDS, axis=0)
        ends = reach(kinematics, theta, anchor[:, :3, 3], anchor[:, :3, :3], _draws(robot, SEEDS, 0))
        branches = np.unique(ends.q[ends.reached()].round(3), axis=0)[:BRANCHES]
        if len(branches):
            break
    else:
        return np.asarray(middle)
    targets = np.tile(some, (len(branches), 1, 1))
    start = np.repeat(branches, len(some), axis=0)
    ends = reach(kinematics, theta, targets[:, :3, 3], targets[:, :3, :3], start, iterations=ITERATIONS)
    room = np.where(robot.prismatic, ROOM * LEVER, ROOM)
    inside = ((ends.q > robot.lower + room) & (ends.q < robot.upper - room)).all(axis=1)
    kept = ends.reached() & inside & (joint_change(robot, start, ends.q).max(axis=1) < np.pi / 2)
    regular = np.where(kept, smallest(kinematics, theta, ends.q), 0.0).reshape(len(branches), -1)
    effort = np.abs((branches - middle) / (robot.upper - robot.lower)).mean(axis=1)
    best = np.lexsort((effort, -regular.min(axis=1).round(2), -(regular > 0).sum(axis=1)))[0]
    return np.asarray(branches[best])


def _middle_turn(T: Float[np.ndarray, "targets 4 4"]) -> Float[np.ndarray, "3 3"]:
    """The orientation of the target whose orientation is nearest to all."""
    mean = T[:, :3, :3].mean(axis=0)
    return np.asarray(T[np.argmax(np.einsum("ikl,kl->i", T[:, :3, :3], mean)), :3, :3])


def _draws(robot: Robot, count: int, seed: int) -> Float[np.ndarray, "count joints"]:
    return np.random.default_rng(seed).uniform(robot.lower, robot.upper, (count, len(robot.joints)))


def _nearest(solved: Float[np.ndarray, "solved 4 4"], open_: Float[np.ndarray, "open 4 4"]) -> np.ndarray:
    """For every open target the solved one that is nearest, orientations counted with LEVER."""
    from scipy.spatial import cKDTree  # half a second to load, and seldom needed

    columns = [np.hstack([T[:, :3, 3], LEVER * T[:, :3, :3].reshape(len(T), 9)]) for T in (solved, open_)]
    return np.asarray(cKDTree(columns[0]).query(columns[1])[1])
