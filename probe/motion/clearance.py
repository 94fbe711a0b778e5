"""Clearance of arm and torch from jig, table and the arm itself: exact distances of capsules, for all postures at once.

Exact distances from the jig's boxes cost less than a look-up in a grid of distances would need in memory and margin.
Where a URDF tells shapes of the arm, a capsule around each is looked at first; what comes too near then is asked again
of the shape itself, where the extra for that is installed (`probe.motion.mesh_distance`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.joint import Capsule
from probe.motion.bodies import Body, bodies, exact_meshes, notes
from probe.motion.distances import Points, segment_segment
from probe.motion.obstacles import Obstacle, obstacles
from probe.motion.torch import torch

if TYPE_CHECKING:
    from probe.motion.mesh_distance import Exact

MARGIN = 10.0  # [mm], from everything else
WIRE = 3.0  # [mm], that the bare wire keeps from all but its own contact
NEAR = 1.0  # [mm], of the torch from the solid whose face it touches: the tip itself holds this distance
CHUNK = 4096  # postures at a time, for the cache
GENERIC = 300  # postures that show which capsules always overlap
CLEAR = -1


@dataclass(frozen=True, eq=False)
class Clearance:
    """The capsules of a robot with its torch among the obstacles of its cell."""

    cell: Cell
    theta: Float[np.ndarray, " parameters"]

    @cached_property
    def capsules(self) -> tuple[Capsule, ...]:
        """Arm and torch; the torch comes last, and goes where the tip has been found to be: behind the wire."""
        last = len(self.cell.robot.joints)
        found = self.cell if self.cell.tool is None else replace(self.cell, tool=self.theta[-6:])
        arm = (c for c in self.cell.robot.capsules if c.link != last)
        return (*(body.capsule for body in self.bodies), *arm, *torch(found))

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """The shapes that the robot has; their capsules come first."""
        return bodies(self.cell.robot)

    @cached_property
    def exact(self) -> "Exact | None":
        """The judge of shapes themselves, where there are any and it is installed."""
        if not self.bodies or not exact_meshes():
            return None
        from probe.motion.mesh_distance import Exact

        rest = self.capsules[len(self.bodies) :]
        return Exact([*(body.shape for body in self.bodies), *rest], self.solids)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is not kept clear of the arm, or not exactly, in sentences."""
        return notes(self.cell.robot)

    @cached_property
    def solids(self) -> tuple[Obstacle, ...]:
        """What not to hit."""
        return () if self.cell.jig is None else obstacles(self.cell.jig)

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Capsules that could hit each other: not neighbours in the chain, nor overlapping in most postures.

        Shapes that meet while all joints read zero are left out, too: a robot is drawn where it does not hit itself, so
        these are drawn into each other.
        """
        robot = self.cell.robot
        q = np.random.default_rng(2).uniform(robot.lower, robot.upper, (GENERIC, len(robot.joints)))
        q[0] = np.clip(0.0, robot.lower, robot.upper)
        frames = self._frames(q)
        ends, links = self._ends(frames), [c.link for c in self.capsules]
        apart = [(i, j) for i in range(len(links)) for j in range(i) if abs(links[i] - links[j]) > 1]
        return tuple((i, j) for i, j in apart if not self._always(i, j, frames, ends, not q[0].any()))

    def _always(
        self, i: int, j: int, frames: Sequence[np.ndarray], ends: list[tuple[Points, Points]], zero: bool
    ) -> bool:
        """Whether two overlap in most postures, or, as shapes, in the first one."""
        gap = self._between(ends, i, j)
        over, bodies = np.flatnonzero(gap <= 0), min(i, j) < len(self.bodies)
        if bodies and self.exact is not None:
            over = over[self.exact.near((i, j, None), frames, over, np.zeros(len(over)))]
        return 2 * len(over) >= len(gap) or bool(bodies and zero and len(over) and over[0] == 0)

    def _frames(self, q: Float[np.ndarray, "postures joints"]) -> Sequence[Float[np.ndarray, "postures 3 4"]]:
        return self.cell.kinematics.links(q, self.theta)

    def ends(self, q: Float[np.ndarray, "postures joints"]) -> list[tuple[Points, Points]]:
        """Both ends of every capsule in the jig frame [mm], coordinates first."""
        return self._ends(self._frames(q))

    def _ends(self, frames: Sequence[Float[np.ndarray, "postures 3 4"]]) -> list[tuple[Points, Points]]:
        out = []
        for capsule in self.capsules:
            T = np.ascontiguousarray(frames[capsule.link].transpose(1, 2, 0))
            start, end = (np.einsum("ijm,j->im", T[:, :3], np.array(p)) + T[:, 3] for p in (capsule.start, capsule.end))
            out.append((start, end))
        return out

    def gaps(
        self, q: Float[np.ndarray, "postures joints"]
    ) -> tuple[Float[np.ndarray, " postures"], Float[np.ndarray, " postures"]]:
        """Smallest distances of the surface of arm and torch from the obstacles, and from each other [mm].

        Negative where they meet, but no deeper than a radius; infinite where nothing could meet.
        """
        outside, inside = np.full(len(q), np.inf), np.full(len(q), np.inf)
        for part in _chunks(len(q)):
            frames = self._frames(q[part])
            ends = self._ends(frames)
            for i, ((start, end), capsule) in enumerate(zip(ends, self.capsules, strict=True)):
                for k, solid in enumerate(self.solids if capsule.link else ()):
                    gap = solid.segment(start, end) - capsule.radius
                    outside[part] = self._least(outside[part], gap, (i, None, k), frames)
            for i, j in self.pairs:
                inside[part] = self._least(inside[part], self._between(ends, i, j), (i, j, None), frames)
        return outside, inside

    def _least(
        self,
        so_far: np.ndarray,
        gap: np.ndarray,
        pair: tuple[int, int | None, int | None],
        frames: Sequence[np.ndarray],
    ) -> Float[np.ndarray, " postures"]:
        """The smaller of distances so far and those of a pair, known of its capsules: less than those of its shapes."""
        less = np.flatnonzero(gap < so_far)
        if self._shaped(pair):
            assert self.exact is not None
            gap[less] = self.exact.distances(pair, frames, less)
        return np.minimum(so_far, gap)

    def hits(
        self,
        q: Float[np.ndarray, "postures joints"],
        own: Bool[np.ndarray, "postures obstacles"] | None = None,
        margin: float | Float[np.ndarray, " postures"] = MARGIN,
    ) -> Int[np.ndarray, " postures"]:
        """What a posture comes nearer to than `margin` [mm]: index of an obstacle, their number for the arm, or CLEAR.

        `own` are obstacles that the torch may approach to NEAR, because it touches them. Arm and torch know where they
        are to each other: there MARGIN is enough, whatever is asked of the way to the jig.
        """
        hit, margin = np.full(len(q), CLEAR), np.broadcast_to(margin, len(q))
        for part in _chunks(len(q)):
            frames, found = self._frames(q[part]), hit[part]
            ends = self._ends(frames)
            for i, (capsule, (start, end)) in enumerate(zip(self.capsules, ends, strict=True)):
                for k, solid in enumerate(self.solids if capsule.link else ()):
                    near = self._torch(capsule) & (False if own is None else own[part, k])
                    need = np.where(near, NEAR, margin[part])
                    close = _closer(solid, start, end, capsule.radius + need)
                    found[self._confirmed((i, None, k), frames, close, need, found)] = k
            need = np.minimum(margin[part], MARGIN)
            for i, j in self.pairs:
                close = np.flatnonzero(self._between(ends, i, j) < need)
                found[self._confirmed((i, j, None), frames, close, need, found)] = len(self.solids)
        return hit

    def _confirmed(
        self, pair: tuple[int, int | None, int | None], frames: Sequence[np.ndarray], close: Int[np.ndarray, " some"],
        need: Float[np.ndarray, " postures"], found: Int[np.ndarray, " postures"],
    ) -> Int[np.ndarray, " fewer"]:  # fmt: skip
        """Of postures in which two capsules come too near, those in which the shapes do; none that hits anyway."""
        if not self._shaped(pair):
            return close
        assert self.exact is not None
        close = close[found[close] == CLEAR]
        return close[self.exact.near(pair, frames, close, need[close])]

    def _shaped(self, pair: tuple[int, int | None, int | None]) -> bool:
        """Whether a pair is of shapes that can be asked themselves."""
        known = len(self.bodies)
        return self.exact is not None and (pair[0] < known or (pair[1] is not None and pair[1] < known))

    def _torch(self, capsule: Capsule) -> bool:
        return capsule.link == len(self.cell.robot.joints)

    def _between(self, ends: list[tuple[Points, Points]], i: int, j: int) -> Float[np.ndarray, " postures"]:
        return segment_segment(*ends[i], *ends[j]) - self.capsules[i].radius - self.capsules[j].radius


def _closer(solid: Obstacle, start: Points, end: Points, need: Float[np.ndarray, "..."]) -> Int[np.ndarray, " some"]:
    """Segments that come closer to a solid than `need` [mm]; only where the middle is near, the distance is taken."""
    half = np.sqrt(((end - start) ** 2).sum(axis=0)) / 2
    need = np.broadcast_to(need, half.shape)
    close = np.flatnonzero(solid.point((start + end) / 2) < half + need)
    return close[solid.segment(start[:, close], end[:, close]) < need[close]] if len(close) else close


def _chunks(rows: int) -> list[slice]:
    return [slice(i, min(i + CHUNK, rows)) for i in range(0, rows, CHUNK)]
