"""Whether shapes come too near where the capsules around them do: their parts are asked first, then they themselves.

Links two joints apart are near each other in most postures, and all that matters is the two joints between them: their
distance is tabulated over these joints, as far as it is asked for.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.joint import Capsule
from identify.model.robot import Robot
from probe.motion.bodies import Body
from probe.motion.distances import Boxes, Frames, near_boxes, placed, slices
from probe.motion.mesh_distance import Exact, Pair

ROWS = 4096  # postures at a time
CELL = np.radians(2.0)  # of a table
SLACK = 0.5  # [mm], for what other joints change between two links: compliance


@dataclass(frozen=True, eq=False)
class Confirmation:
    """The shapes behind the capsules of an arm, and the boxes around obstacles."""

    robot: Robot
    exact: Exact
    bodies: tuple[Body, ...]  # behind the first capsules
    capsules: tuple[Capsule, ...]
    boxes: tuple[Boxes, ...]
    frames: Callable[[Float[np.ndarray, "postures joints"]], Frames]

    def near(
        self,
        pair: Pair,
        q: Float[np.ndarray, "postures joints"],
        frames: Frames,
        rows: Int[np.ndarray, " some"],
        need: Float[np.ndarray, " some"],
    ) -> Int[np.ndarray, " fewer"]:
        """Of some postures, those in which the shapes of a pair come nearer than `need` [mm]."""
        out = [np.empty(0, dtype=int)]
        for chunk in slices(len(rows), ROWS):
            some, least = rows[chunk], need[chunk]
            maybe = self._maybe_near(pair, q[some], [T[some] for T in frames], least)
            some, least = some[maybe], least[maybe]
            out.append(some[self.exact.near(pair, frames, some, least)])
        return np.concatenate(out)

    def _maybe_near(
        self, pair: Pair, q: Float[np.ndarray, "some joints"], frames: Frames, need: Float[np.ndarray, " some"]
    ) -> Bool[np.ndarray, " some"]:
        """Postures in which bounds do not show that a pair is clear."""
        i, j, k = pair
        if k is None:
            assert j is not None
            table = self._table(i, j)
            return np.ones(len(q), dtype=bool) if table is None else table.bound(q) < need
        parts = self.bodies[i].parts if i < len(self.bodies) else (self.capsules[i],)
        start, end = placed(parts, frames)
        reach = need + np.array([c.radius for c in parts])[:, None, None]
        out = np.zeros(len(q), dtype=bool)
        for boxes in self.boxes:
            mine = boxes.owner == k
            if mine.any():
                lower, upper = boxes.lower[:, mine], boxes.upper[:, mine]
                out[near_boxes(boxes.seen(start), boxes.seen(end), lower, upper, reach)[2]] = True
        return out

    def _table(self, i: int, j: int) -> "Table | None":
        """The table of two links with two turning joints between them."""
        low, high = sorted((self.capsules[i].link, self.capsules[j].link))
        if high - low != 2 or any(self.robot.prismatic[low:high]):
            return None
        if (i, j) not in self._tables:
            far = self.capsules[i] if self.capsules[i].link == high else self.capsules[j]
            self._tables[i, j] = Table(self, (i, j, None), low, _reach(self.robot, far))
        return self._tables[i, j]

    @cached_property
    def _tables(self) -> dict[tuple[int, int], "Table"]:
        return {}


class Table:
    """Lower bounds on the distance of two links over the two joints between them, each found when first asked for."""

    def __init__(self, shapes: Confirmation, pair: Pair, low: int, reach: tuple[float, float]) -> None:
        self.shapes, self.pair, self.joints = shapes, pair, slice(low, low + 2)
        robot = shapes.robot
        self.lower = robot.lower[self.joints]
        self.size = np.ceil((robot.upper - robot.lower)[self.joints] / CELL).astype(int) + 1
        self.slack = CELL / 2 * sum(reach) + SLACK
        self.distance = np.full(self.size.prod(), np.nan)  # [mm], in the middle of cells

    def bound(self, q: Float[np.ndarray, "postures joints"]) -> Float[np.ndarray, " postures"]:
        """Distances that two links have at least [mm]."""
        place = np.rint((q[:, self.joints] - self.lower) / CELL).astype(int)
        inside = ((place >= 0) & (place < self.size)).all(axis=1)
        cell = np.where(inside, place[:, 0] * self.size[1] + place[:, 1], 0)
        new = np.unique(cell[np.isnan(self.distance[cell])])
        if len(new):
            middle = np.zeros((len(new), len(self.shapes.robot.joints)))
            middle[:, self.joints] = self.lower + np.stack(np.divmod(new, self.size[1]), axis=1) * CELL
            self.distance[new] = self.shapes.exact.distances(self.pair, self.shapes.frames(middle), np.arange(len(new)))
        return np.where(inside, self.distance[cell] - self.slack, -np.inf)


def _reach(robot: Robot, capsule: Capsule) -> tuple[float, float]:
    """How far a solid in a capsule reaches from the axes of the last two joints before it, at most [mm]."""
    far = max(float(np.linalg.norm(p)) for p in (capsule.start, capsule.end)) + capsule.radius
    last, before = robot.joints[capsule.link - 1], robot.joints[capsule.link - 2]
    return abs(last.a) + far, abs(before.a) + float(np.hypot(last.a, last.d)) + far
