"""Swaps judged by several robots at once: sets that suit all that a robot may be, not only the most likely one."""

from collections.abc import Sequence
from copy import copy
from typing import Self

import numpy as np
from jaxtyping import Float, Int

from oed.criteria.first_order_swaps import promising
from oed.criteria.swaps import Members, Swaps, Table


class RobustSwaps(Swaps):
    """The mean of a criterion's logarithm over robots; each has rows of the same touches, 0 where it misses one.

    With `weights`, some count more than others.
    """

    def __init__(self, robots: Sequence[Swaps], weights: Sequence[float] | None = None):
        self.robots = list(robots)
        self.weights = np.ones(len(robots)) if weights is None else np.array(weights)
        super().__init__(robots[0].rows, robots[0].before, robots[0].criterion)

    def among(self, index: Int[np.ndarray, " some"]) -> Self:
        """The same for some of the rows."""
        other = copy(self)
        other.robots = [robot.among(index) for robot in self.robots]
        other._hold(self.rows[index])
        return other

    def log(self, members: Members) -> float:
        """Mean of the logarithms."""
        return float(np.average([robot.log(members) for robot in self.robots], weights=self.weights))

    def gains(self, members: Members) -> Float[np.ndarray, " pool"]:
        """Mean gain: the least one would be of robots that are well off already."""
        return np.average([robot.gains(members) for robot in self.robots], axis=0, weights=self.weights)

    def losses(self, members: Members) -> Float[np.ndarray, " touches"]:
        """Mean loss."""
        return np.average([robot.losses(members) for robot in self.robots], axis=0, weights=self.weights)

    def load(self, members: Members) -> None:
        """Make a set the present one, of every robot."""
        super().load(members)
        for robot in self.robots:
            robot.load(members)

    def swap(self, a: int, j: int) -> None:
        """The same swap for every robot."""
        self.members[a] = j
        for robot in self.robots:
            robot.swap(a, j)

    def table(self) -> Table:
        """By how much the logarithm grows."""
        total = np.zeros((len(self.members), len(self.rows)))
        for robot, weight in zip(self.robots, self.weights.tolist(), strict=True):
            total += weight * robot.growth(robot.table())
        return np.asarray(total / self.weights.sum())

    def growth(self, table: Table) -> Table:
        """The table itself."""
        return table

    def look_wider(self) -> bool:
        """Whether some robot has another table to look at."""
        wider = [robot.look_wider() for robot in self.robots]  # all of them, in step
        return any(wider)

    def best(self, table: Table) -> tuple[int, int, float]:
        """The best swap, and the factor by which the criterion grows; computed where tables only rank."""
        if all(robot.exact for robot in self.robots):
            a, j = divmod(int(table.argmax()), table.shape[1])
            return a, j, float(np.exp(table[a, j]))
        first, second = promising(table)
        if not len(first):
            return 0, 0, 0.0
        logs = np.average([r.logs_after(first, second) for r in self.robots], axis=0, weights=self.weights)
        k = int(np.argmax(logs))
        return int(first[k]), int(second[k]), float(np.exp(logs[k] - self.log(self.members)))
