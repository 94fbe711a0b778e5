"""Clearance of arm and torch from jig, table and the arm itself, for many postures at once.

Capsules against boxes and capsules against each other are exact and cost a few operations a pair (`distances`). Where a
shape stands behind a capsule, the capsule is asked first, then the parts of the shape, and only what these cannot
decide is asked of the shape itself, where the extra for that is installed (`mesh_distance`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.joint import Capsule
from probe.motion.bodies import Body, bodies, exact_meshes
from probe.motion.distances import (
    Boxes,
    Frames,
    Points,
    Segments,
    near_boxes,
    near_segments,
    placed,
    segment_box,
    segment_box_bound,
    segment_segment,
    slices,
)
from probe.motion.link_pairs import link_pairs
from probe.motion.obstacles import Obstacle, boxes_around, obstacles
from probe.motion.torch import STICKOUT, torch

if TYPE_CHECKING:
    from probe.motion.confirmation import Confirmation
    from probe.motion.mesh_distance import Exact, Pair

MARGIN = 10.0  # [mm], from everything else
WIRE = 3.0  # [mm], that the bare wire keeps from all but its own contact
NEAR = 1.0  # [mm], of the torch from the solid whose face it touches: the tip itself holds this distance
CHUNK = 1 << 17  # pairs of capsules and boxes at a time, for the cache
MANY = 1 << 20  # of them, where bounds look at fewer at a time anyway: so that memory stays bounded
CLEAR = -1


@dataclass(frozen=True, eq=False)
class Clearance:
    """The capsules of a robot with its torch among the obstacles of its cell."""

    cell: Cell
    theta: Float[np.ndarray, " parameters"]

    def at(self, theta: Float[np.ndarray, " parameters"]) -> "Clearance":
        """The same cell with a robot of other parameters; what does not depend on them is taken over."""
        other = replace(self, theta=theta)
        other.__dict__.update({name: getattr(self, name) for name in ("bodies", "solids", "boxes", "pairs")})
        return other

    @cached_property
    def arm(self) -> "Clearance":
        """The links before the last one among the obstacles: what a search that goes on must keep clear, too."""
        other, moving = self.at(self.theta), self._moving[~self._torch[self._moving]]
        other.__dict__.update({"capsules": self.capsules, "pairs": (), "_moving": moving})
        return other

    @cached_property
    def capsules(self) -> tuple[Capsule, ...]:
        """Arm and torch; the torch comes last, and goes where the tip is by the parameters: behind the wire."""
        last = len(self.cell.robot.joints)
        cell = self.cell if self.cell.tool is None else replace(self.cell, tool=self.theta[-6:])
        arm = (c for c in self.cell.robot.capsules if c.link != last)
        return (*(body.capsule for body in self.bodies), *arm, *torch(cell))

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """The shapes that the robot has; their capsules come first."""
        return bodies(self.cell.robot)

    @cached_property
    def exact(self) -> "Exact | None":
        """The distances of shapes themselves, where there are any and the extra is installed."""
        if not (self.bodies or any(solid.shape for solid in self.solids)) or not exact_meshes():
            return None
        from probe.motion.mesh_distance import Exact

        return Exact([*(body.shape for body in self.bodies), *self.capsules[len(self.bodies) :]], self.solids)

    @cached_property
    def solids(self) -> tuple[Obstacle, ...]:
        """What not to hit."""
        return obstacles(self.cell.jig, self.cell.obstacles)

    @cached_property
    def boxes(self) -> tuple[Boxes, ...]:
        """The boxes around all obstacles, those with the same axes together."""
        return boxes_around(self.solids)

    @cached_property
    def radius(self) -> Float[np.ndarray, " capsules"]:
        """Radii of the capsules [mm]."""
        return np.array([c.radius for c in self.capsules])

    @cached_property
    def _torch(self) -> Bool[np.ndarray, " capsules"]:
        """Whether each capsule moves with the last link."""
        return np.array([c.link == len(self.cell.robot.joints) for c in self.capsules], dtype=bool)

    @cached_property
    def _moving(self) -> Int[np.ndarray, " moving"]:
        return np.array([i for i, c in enumerate(self.capsules) if c.link], dtype=int)

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Capsules that could hit each other."""
        return link_pairs(self.cell.robot, self.capsules, len(self.bodies), self.frames, self._overlapping)

    def _overlapping(self, i: int, j: int, frames: Frames, rows: Int[np.ndarray, " rows"]) -> Int[np.ndarray, " some"]:
        """Of postures in which two capsules overlap, those in which the shapes do."""
        if self.exact is None or not self.shaped((i, j, None)):
            return rows
        return rows[self.exact.near((i, j, None), frames, rows, np.zeros(len(rows)))]

    def frames(self, q: Float[np.ndarray, "postures joints"]) -> Frames:
        """Where the links are, in the jig frame [mm]."""
        return self.cell.kinematics.links(q, self.theta)

    def ends(self, q: Float[np.ndarray, "postures joints"]) -> tuple[Segments, Segments]:
        """Both ends of every capsule in the jig frame [mm]."""
        return placed(self.capsules, self.frames(q))

    def wire(self, q: Float[np.ndarray, "postures joints"]) -> tuple[Points, Points]:
        """Both ends of the bare wire in the jig frame [mm], the tip first."""
        tip, R = self.cell.kinematics.tip(q, self.theta)
        return tip.T, (tip - STICKOUT * R[:, :, 2]).T

    def hits(
        self,
        q: Float[np.ndarray, "postures joints"],
        own: Bool[np.ndarray, "postures obstacles"] | None = None,
        margin: float | Float[np.ndarray, " postures"] = MARGIN,
        inside: float | Float[np.ndarray, " postures"] = MARGIN,
    ) -> Int[np.ndarray, " postures"]:
        """What a posture comes nearer to than `margin` [mm]: index of an obstacle, their number for the arm, or CLEAR.

        Obstacles come first. `own` are obstacles that the torch may approach to NEAR, because it touches them. Arm and
        torch know where they are to each other: there `inside` is enough, whatever is asked of the way to the jig.
        """
        hit, margin = np.full(len(q), CLEAR), np.broadcast_to(margin, len(q))
        least = np.minimum(margin, inside)
        for part in self._chunks(len(q), MANY):
            frames, out = self.frames(q[part]), hit[part]
            ends = placed(self.capsules, frames)
            self._against_obstacles(q[part], frames, ends, None if own is None else own[part], margin[part], out)
            self._against_itself(q[part], frames, ends, least[part], out)
        return hit

    def _against_obstacles(
        self,
        q: Float[np.ndarray, "postures joints"],
        frames: Frames,
        ends: tuple[Segments, Segments],
        own: Bool[np.ndarray, "postures obstacles"] | None,
        margin: Float[np.ndarray, " postures"],
        out: Int[np.ndarray, " postures"],
    ) -> None:
        """Note the obstacle that each posture hits in `out`."""
        unsure = dict[tuple[int, int], list[np.ndarray]]()
        for boxes in self.boxes:
            start, end = boxes.seen(ends[0][:, self._moving]), boxes.seen(ends[1][:, self._moving])
            need = np.broadcast_to(margin, (len(self._moving), len(boxes.owner), len(margin)))
            if own is not None:
                touched = self._torch[self._moving][:, None, None] & own.T[boxes.owner]
                need = np.where(touched, NEAR, need)
            reach = need + self.radius[self._moving][:, None, None]
            near, box, m = near_boxes(start, end, boxes.lower, boxes.upper, reach)
            one, other = self._moving[near], boxes.owner[box]
            sure = ~self._shaped_pairs[one, other]
            out[m[sure]] = other[sure]
            code = (one * len(self.solids) + other)[~sure]
            for pair in np.unique(code).tolist():
                unsure.setdefault(divmod(pair, len(self.solids)), []).append(m[~sure][code == pair])
        for (i, k), rows in unsure.items():
            some = np.unique(np.concatenate(rows))
            some = some[out[some] == CLEAR]
            need = margin[some] if own is None or not self._torch[i] else np.where(own[some, k], NEAR, margin[some])
            assert self._shapes is not None
            out[self._shapes.near((i, None, k), q, frames, some, need)] = k

    def _against_itself(
        self,
        q: Float[np.ndarray, "postures joints"],
        frames: Frames,
        ends: tuple[Segments, Segments],
        margin: Float[np.ndarray, " postures"],
        out: Int[np.ndarray, " postures"],
    ) -> None:
        """Note the postures in which arm and torch come too near to each other in `out`."""
        first, second = np.array(self.pairs, dtype=int).reshape(-1, 2).T
        reach, clear = (self.radius[first] + self.radius[second])[:, None], np.flatnonzero(out == CLEAR)
        near = np.maximum(margin[clear], 0.0) + reach
        p, m = near_segments(ends[0][:, :, clear], ends[1][:, :, clear], first, second, near)
        for k in np.unique(p).tolist():
            pair, rows = (int(first[k]), int(second[k]), None), clear[m[p == k]]
            if self.shaped(pair):
                assert self._shapes is not None
                rows = rows[out[rows] == CLEAR]
                rows = self._shapes.near(pair, q, frames, rows, margin[rows])
            out[rows] = len(self.solids)

    @cached_property
    def _shapes(self) -> "Confirmation | None":
        """The shapes behind capsules and obstacles, where there are any and the extra is installed."""
        if self.exact is None:
            return None
        from probe.motion.confirmation import Confirmation

        return Confirmation(self.cell.robot, self.exact, self.bodies, self.capsules, self.boxes, self.frames)

    @cached_property
    def _shaped_pairs(self) -> Bool[np.ndarray, "capsules obstacles"]:
        some = [[self.shaped((i, None, k)) for k in range(len(self.solids))] for i in range(len(self.capsules))]
        return np.array(some, dtype=bool).reshape(len(self.capsules), len(self.solids))

    def shaped(self, pair: "Pair") -> bool:
        """Whether a pair is of shapes that can be asked themselves."""
        *links, k = pair
        linked = min(i for i in links if i is not None) < len(self.bodies)
        return self.exact is not None and (linked or bool(k is not None and self.solids[k].shape))

    def segments_near(self, start: Points, end: Points, need: Float[np.ndarray, " rows"]) -> Bool[np.ndarray, " rows"]:
        """Segments, of a bare wire for instance, that come nearer to any obstacle than `need` [mm]."""
        out = np.zeros(start.shape[1], dtype=bool)
        for boxes in self.boxes:
            a, b = boxes.seen(start[:, None]), boxes.seen(end[:, None])
            _, k, m = near_boxes(a, b, boxes.lower, boxes.upper, need[None, None])
            k = boxes.owner[k]
            for i in np.unique(k).tolist():
                rows = np.unique(m[k == i])
                if self.exact is not None and self.solids[i].shape is not None:
                    rows = rows[~out[rows]]
                    rows = rows[self.exact.segments_near(i, start[:, rows], end[:, rows], need[rows])]
                out[rows] = True
        return out

    def segment_gaps(self, start: Points, end: Points, most: float = np.inf) -> Float[np.ndarray, " rows"]:
        """Distances of segments, of a bare wire for instance, from the nearest obstacle, `most` where more [mm]."""
        out = np.full(start.shape[1], most)
        for boxes in self.boxes:
            a, b = boxes.seen(start[:, None]), boxes.seen(end[:, None])
            bound = np.sqrt(segment_box_bound(a, b, boxes.lower, boxes.upper))[0]
            for n, k in enumerate(boxes.owner.tolist()):
                rows = np.flatnonzero(bound[n] < out)
                if self.exact is not None and self.solids[k].shape is not None:
                    gap = self.exact.segment_distances(k, start[:, rows], end[:, rows])
                else:
                    gap = segment_box(a[:, 0, rows], b[:, 0, rows], boxes.lower[:, n], boxes.upper[:, n])
                out[rows] = np.minimum(out[rows], gap)
        return out

    def gaps(
        self, q: Float[np.ndarray, "postures joints"], most: float = np.inf
    ) -> tuple[Float[np.ndarray, " postures"], Float[np.ndarray, " postures"]]:
        """Smallest distances of arm and torch from the obstacles, and from each other, `most` where they are more [mm].

        Negative where they meet, but no deeper than a radius; infinite where nothing could meet.
        """
        outside, inside = np.full(len(q), most), np.full(len(q), most)
        for part in self._chunks(len(q), CHUNK):
            frames = self.frames(q[part])
            start, end = placed(self.capsules, frames)
            for boxes in self.boxes:
                a, b = boxes.seen(start), boxes.seen(end)
                bound = np.sqrt(segment_box_bound(a, b, boxes.lower, boxes.upper))
                for i in self._moving.tolist():
                    for n, k in enumerate(boxes.owner.tolist()):
                        some = np.flatnonzero(bound[i, n] - self.radius[i] < outside[part])
                        gap = segment_box(a[:, i, some], b[:, i, some], boxes.lower[:, n], boxes.upper[:, n])
                        self._lower(outside[part], some, gap - self.radius[i], (i, None, k), frames)
            for i, j in self.pairs:
                gap = segment_segment(start[:, i], end[:, i], start[:, j], end[:, j])
                gap -= self.radius[i] + self.radius[j]
                self._lower(inside[part], np.arange(len(gap)), gap, (i, j, None), frames)
        return outside, inside

    def _lower(
        self, least: np.ndarray, rows: Int[np.ndarray, " some"], gap: np.ndarray, pair: "Pair", frames: Frames
    ) -> None:
        """Lower some of the least distances to those of a pair, of its shapes where capsules are nearer."""
        less = gap < least[rows]
        rows, gap = rows[less], gap[less]
        if self.shaped(pair):
            assert self.exact is not None
            gap = self.exact.distances(pair, frames, rows)
        least[rows] = np.minimum(least[rows], gap)

    def _chunks(self, rows: int, pairs: int) -> Iterator[slice]:
        boxes = sum(len(boxes.owner) for boxes in self.boxes)
        return slices(rows, max(pairs // max(len(self.capsules) * max(boxes, len(self.pairs)), 1), 64))
