"""Clearance of arm and torch from jig, table and the arm itself: exact distances of capsules, for all postures at once.

Exact distances from the jig's boxes cost less than a look-up in a grid of distances would need in memory and margin.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.robot import Capsule
from oed.distances import Points, segment_segment
from oed.obstacles import Obstacle, obstacles
from oed.torch import torch

MARGIN = 10.0  # [mm], from everything else
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
        return (*(c for c in self.cell.robot.capsules if c.link != last), *torch(found))

    @cached_property
    def solids(self) -> tuple[Obstacle, ...]:
        """What not to hit."""
        return () if self.cell.jig is None else obstacles(self.cell.jig)

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Capsules that could hit each other: not neighbours in the chain, nor overlapping in most postures."""
        robot = self.cell.robot
        q = np.random.default_rng(2).uniform(robot.lower, robot.upper, (GENERIC, len(robot.joints)))
        ends = self.ends(q)
        links = [c.link for c in self.capsules]
        apart = [(i, j) for i in range(len(links)) for j in range(i) if abs(links[i] - links[j]) > 1]
        return tuple((i, j) for i, j in apart if np.median(self._between(ends, i, j)) > 0)

    def ends(self, q: Float[np.ndarray, "postures joints"]) -> list[tuple[Points, Points]]:
        """Both ends of every capsule in the jig frame [mm], coordinates first."""
        frames = self.cell.kinematics.links(q, self.theta)
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
            ends = self.ends(q[part])
            for (start, end), capsule in zip(ends, self.capsules, strict=True):
                for solid in self.solids if capsule.link else ():
                    outside[part] = np.minimum(outside[part], solid.segment(start, end) - capsule.radius)
            for i, j in self.pairs:
                inside[part] = np.minimum(inside[part], self._between(ends, i, j))
        return outside, inside

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
            ends = self.ends(q[part])
            for capsule, (start, end) in zip(self.capsules, ends, strict=True):
                for k, solid in enumerate(self.solids if capsule.link else ()):
                    near = self._torch(capsule) & (False if own is None else own[part, k])
                    need = capsule.radius + np.where(near, NEAR, margin[part])
                    hit[part][_closer(solid, start, end, need)] = k
            for i, j in self.pairs:
                hit[part][self._between(ends, i, j) < np.minimum(margin[part], MARGIN)] = len(self.solids)
        return hit

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
