"""All branches of the inverse kinematics of many poses: a few from many starts, the others from their neighbours."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.ik import EDGE, reach
from identify.model.ik_step import AXIS, LEVER, POINT, POSE
from identify.model.robot import Robot

STARTS = 24  # random ones for each of the first poses: 98 of 100 solutions of a 6-axis arm are found by so many
SEEDS, POSES = 300, 3000  # poses that get them, and poses whose solutions are kept as starts for all others
SLACK = 0.2  # [rad] or [LEVER mm] beyond the joint limits, for a start whose solution may lie within
MOST, SOME = 16, 8  # solutions kept of a pose: a 6-axis arm has no more; a redundant one has infinitely many
WANDER = 0.3  # [rad] or [LEVER mm], 1 sigma of the way off from known solutions, where solutions fill a curve
BESIDE = 0.8  # [rad] or [LEVER mm]: a start that near to a solution leads to it
ITERATIONS = 10  # from a neighbour
TOLERANCE = 1e-4  # [mm]
SAME = 1e-5  # difference of the keys of equal solutions
BLOCK = 1024


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the tip in the jig frame, in groups that lie apart: no neighbour is looked for in another group."""

    position: Float[np.ndarray, "poses 3"]  # [mm]
    rotation: Float[np.ndarray, "poses 3 3"]
    group: Int[np.ndarray, " poses"]

    def __len__(self) -> int:
        return len(self.position)

    def take(self, index: Int[np.ndarray, " some"] | slice) -> "Poses":
        """Some of the poses."""
        return Poses(self.position[index], self.rotation[index], self.group[index])


@dataclass(frozen=True, eq=False)
class Solutions:
    """Joint values that bring the tip to poses; `pose` counts through these, in rising order."""

    poses: Poses
    pose: Int[np.ndarray, " solutions"]
    q: Float[np.ndarray, "solutions joints"]  # [rad] or [mm]

    def where(self, keep: Bool[np.ndarray, " solutions"]) -> "Solutions":
        """Some of the solutions, of the same poses."""
        return Solutions(self.poses, self.pose[keep], self.q[keep])

    def within(self, robot: Robot, slack: float = 0.0) -> "Solutions":
        """Solutions within the joint limits, or not further beyond than `slack` [rad] or [LEVER mm]."""
        room = slack * np.where(robot.prismatic, LEVER, 1.0)
        nearest = np.clip(self.q, robot.lower - room, robot.upper + room)
        return self.where(np.asarray((np.abs(self.q - nearest) <= EDGE).all(axis=1)))


class Branches:
    """Inverse kinematics by continuation: what was solved for some poses is the start for those around them."""

    def __init__(self, cell: Cell, theta: Float[np.ndarray, " parameters"], around: Poses, rng: np.random.Generator):
        """Solve some of the poses `around` which others will be asked for."""
        self.cell, self.theta, self.rng = cell, theta, rng
        self.order = rng.permutation(len(around))[:POSES]  # of the known poses among those `around`
        first, others = around.take(self.order[:SEEDS]), around.take(self.order[SEEDS:])
        pose = np.repeat(np.arange(len(first)), STARTS)
        start = rng.uniform(cell.robot.lower, cell.robot.upper, (len(pose), len(cell.robot.joints)))
        self.known = seeds = self._solved(first, pose, start, 40)
        rest = self._both(others, seeds, self._seeded(others))
        pose, q = np.concatenate([seeds.pose, rest.pose + len(first)]), np.concatenate([seeds.q, rest.q])
        self.known = Solutions(around.take(self.order), pose, q)

    def solve(self, poses: Poses) -> Solutions:
        """Solutions within the joint limits, from those of the two nearest known poses of the group."""
        near = self.known.within(self.cell.robot, SLACK)
        some, neighbours = self._features(poses), self._features(near.poses)
        neighbour = np.full((len(poses), 2), -1)
        for group in np.unique(poses.group):
            here, there = poses.group == group, np.flatnonzero(near.poses.group == group)
            if len(there) > 1:
                neighbour[here] = there[_nearest(some[here], neighbours[there], 2)]
        return self._both(poses, near, neighbour).within(self.cell.robot)

    def _both(self, poses: Poses, near: Solutions, neighbour: Int[np.ndarray, "poses 2"]) -> Solutions:
        """Solutions from those of two neighbours (-1: none)."""
        first = self._continued(poses, near, neighbour[:, 0], None)
        second = self._continued(poses, near, neighbour[:, 1], first)
        pose, q = np.concatenate([first.pose, second.pose]), np.concatenate([first.q, second.q])
        keep = distinct(self.cell.robot, pose, q, self._most)
        return Solutions(poses, pose[keep], q[keep])

    def _continued(
        self, poses: Poses, near: Solutions, neighbour: Int[np.ndarray, " poses"], besides: Solutions | None
    ) -> Solutions:
        """Start from all solutions of a neighbour, but for those next to what was found `besides`."""
        robot = self.cell.robot
        count = np.bincount(near.pose, minlength=len(near.poses))
        first, times = np.searchsorted(near.pose, neighbour), np.where(neighbour < 0, 0, count[neighbour])
        pose = np.repeat(np.arange(len(poses)), times)
        place = np.arange(len(pose)) - np.repeat(np.cumsum(times) - times, times)
        start = near.q[np.repeat(first, times) + place]
        if besides is not None:
            new = _new(robot, besides, pose, start)
            pose, start = pose[new], start[new]
        if self.task < len(robot.joints):  # infinitely many solutions: not the same ones for all poses in one place
            start = start + WANDER * np.where(robot.prismatic, LEVER, 1.0) * self.rng.normal(size=start.shape)
        return self._solved(poses, pose, start, ITERATIONS)

    def _seeded(self, poses: Poses) -> Int[np.ndarray, "poses 2"]:
        """The nearest seeds that have solutions, in any group; -1 where there is none."""
        usable = np.unique(self.known.pose)
        if len(usable) < 2:
            return np.full((len(poses), 2), -1)
        return usable[_nearest(self._features(poses), self._features(self.known.poses.take(usable)), 2)]

    @property
    def _most(self) -> int:
        return SOME if self.task < len(self.cell.robot.joints) else MOST

    @property
    def task(self) -> int:
        """Rows of what is asked: a robot of less than six joints is not asked to stand in any way but its own."""
        joints = len(self.cell.robot.joints)
        return POSE if joints >= 6 else AXIS if joints == 5 else POINT

    def _solved(self, poses: Poses, pose: Int[np.ndarray, " starts"], start: np.ndarray, iterations: int) -> Solutions:
        """Solutions from given starts, each once."""
        ends = reach(
            self.cell.kinematics,
            self.theta,
            poses.position[pose],
            poses.rotation[pose],
            start,
            free_roll=self.task == AXIS,
            free_orientation=self.task == POINT,
            iterations=iterations,
        )
        ok = ends.residual < TOLERANCE
        keep = distinct(self.cell.robot, pose[ok], ends.q[ok], self._most)
        return Solutions(poses, pose[ok][keep], ends.q[ok][keep])

    def _features(self, poses: Poses) -> Float[np.ndarray, "poses features"]:
        """Numbers whose Euclidean distance tells how far poses are apart, in radians or LEVER millimetres."""
        turn = poses.rotation[:, :, {POSE: 0, AXIS: 2, POINT: 3}[self.task] :]
        flat = turn.reshape(len(poses), 3 * turn.shape[2]) / np.sqrt(2)
        return np.concatenate([poses.position / LEVER, flat], axis=1)


def distinct(
    robot: Robot, pose: Int[np.ndarray, " solutions"], q: Float[np.ndarray, "solutions joints"], most: int = MOST
) -> Int[np.ndarray, " distinct"]:
    """Indices of solutions of a pose that differ by more than whole turns, so many at the `most`, pose by pose.

    Solutions are told apart by one number, their angles seen from a fixed odd direction.
    """
    odd = np.random.default_rng(3).normal(size=(2, q.shape[1]))
    slides = np.array(robot.prismatic)
    key = np.where(slides, q / LEVER, np.cos(q)) @ odd[0] + np.where(slides, 0.0, np.sin(q)) @ odd[1]
    order = np.lexsort((key, pose))
    pose, key = pose[order], key[order]
    new = np.concatenate([[True], (np.diff(pose) > 0) | (np.diff(key) > SAME)])[: len(pose)]
    order, pose = order[new], pose[new]
    rank = np.arange(len(pose)) - np.searchsorted(pose, pose)
    return order[rank < most]


def _new(
    robot: Robot, solutions: Solutions, pose: Int[np.ndarray, " starts"], start: Float[np.ndarray, "starts joints"]
) -> Bool[np.ndarray, " starts"]:
    """Starts that are not next to a solution which their pose already has."""
    first, behind = np.searchsorted(solutions.pose, pose), np.searchsorted(solutions.pose, pose, side="right")
    slides, new = np.array(robot.prismatic), np.ones(len(pose), dtype=bool)
    for k in range(int((behind - first).max(initial=0))):
        has = np.flatnonzero(first + k < behind)
        way = np.abs(start[has] - solutions.q[first[has] + k])
        way = np.where(slides, way / LEVER, np.minimum(way, np.abs(2 * np.pi - way)))
        new[has] &= way.max(axis=1) > BESIDE
    return new


def _nearest(
    some: Float[np.ndarray, "some features"], neighbours: Float[np.ndarray, "known features"], many: int
) -> Int[np.ndarray, "some many"]:
    """The nearest known points of each, by one matrix product a block."""
    middle = neighbours.mean(axis=0)
    neighbours, some = (neighbours - middle).astype(np.float32), (some - middle).astype(np.float32)
    half = (neighbours**2).sum(axis=1) / 2
    out = np.zeros((len(some), many), dtype=int)
    for i in range(0, len(some), BLOCK):
        near = some[i : i + BLOCK] @ neighbours.T - half
        for k in range(many):
            best = out[i : i + BLOCK, k] = np.argmax(near, axis=1)
            near[np.arange(len(near)), best] = -np.inf
    return out
