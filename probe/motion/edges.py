"""The ways between touches: straight in joint space, clear of jig and arm, and over lifted postures where they must."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.ik_step import LEVER
from probe.motion.clearance import CLEAR, MARGIN, WIRE, Clearance
from probe.motion.torch import STICKOUT

COARSE = 0.2  # [rad] a joint may turn between two postures that are looked at, of ways that could be taken
FINE = 0.03  # [rad], of ways that are taken: what swings half a metre moves less than a nozzle is thick
SHARE = 0.8  # of the distance that the nearer end of a way has, which the way keeps where it cannot keep more


@dataclass(frozen=True, eq=False)
class Edges:
    """Which straight ways in joint space are clear, by as much as the tip may be off.

    A way keeps `keep` from the jig, or most of what both its ends have: like the inset, the margin comes from what is
    known of the robot, and ends where there would be no way left.
    """

    clearance: Clearance
    keep: float = field(default=0.0, kw_only=True)  # [mm]

    def clear(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"], step: float = FINE
    ) -> Bool[np.ndarray, " ways"]:
        """Edges on which arm and torch keep their margin, and the bare wire, between looks too, its own."""
        ok = np.ones(len(start), dtype=bool)
        owner, q = self._postures(start, end, step)
        if not len(owner):
            return ok
        arm, wire = self._margins(start, end)
        ok[owner[self._wire_near(owner, q, wire)]] = False
        left = np.flatnonzero(ok[owner])
        ok[owner[left[self.clearance.hits(q[left], margin=arm[owner[left]]) != CLEAR]]] = False
        return ok

    def among(self, q: Float[np.ndarray, "poses joints"]) -> Bool[np.ndarray, "poses poses"]:
        """Edges between every two poses that seem clear at a coarse look; each way is looked at once."""
        name = [row.tobytes() for row in q]
        a, b = np.triu_indices(len(q), 1)
        pairs = [(name[i], name[j]) for i, j in zip(a.tolist(), b.tolist(), strict=True)]
        new = np.array([k for k, pair in enumerate(pairs) if pair not in self._seen], dtype=int)
        for k, fine in zip(new.tolist(), self.clear(q[a[new]], q[b[new]], COARSE).tolist(), strict=True):
            self._seen[pairs[k]] = self._seen[pairs[k][::-1]] = fine
        out = np.eye(len(q), dtype=bool)
        out[a, b] = out[b, a] = [self._seen[pair] for pair in pairs]
        return out

    @cached_property
    def _seen(self) -> dict[tuple[bytes, bytes], bool]:
        """Edges that were looked at coarsely, by both their ends."""
        return {}

    def _margins(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"]
    ) -> tuple[Float[np.ndarray, " ways"], Float[np.ndarray, " ways"]]:
        """What arm and torch, and what the bare wire keep on ways [mm]."""
        least = MARGIN / 2, WIRE
        if self.keep <= min(least):
            return np.full(len(start), least[0]), np.full(len(start), least[1])
        q, index = np.unique(np.concatenate([start, end]), axis=0, return_inverse=True)
        gaps = self.clearance.gaps(q)[0], self._wire_gap(q)
        nearer = [gap[index.ravel()].reshape(2, -1).min(axis=0) for gap in gaps]
        arm, wire = (
            np.maximum(np.minimum(SHARE * gap, self.keep), low) for gap, low in zip(nearer, least, strict=True)
        )
        return arm, wire

    def _wire_gap(self, q: Float[np.ndarray, "postures joints"]) -> Float[np.ndarray, " postures"]:
        """Distance of the bare wire from the nearest solid [mm]."""
        tip, R = self.clearance.cell.kinematics.tip(q, self.clearance.theta)
        back = (tip - STICKOUT * R[:, :, 2]).T
        gaps = [solid.segment(tip.T, back) for solid in self.clearance.solids]
        return np.min(gaps, axis=0) if gaps else np.full(len(q), np.inf)

    def _postures(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"], step: float
    ) -> tuple[Int[np.ndarray, " postures"], Float[np.ndarray, "postures joints"]]:
        """Postures along ways, no farther apart than `step`, ends included; and the way that each is on."""
        unit = np.where(self.clearance.cell.robot.prismatic, LEVER, 1.0)
        count = 1 + np.ceil(np.maximum(np.abs((end - start) / unit).max(axis=1, initial=0.0) / step, 1)).astype(int)
        owner = np.repeat(np.arange(len(start)), count)
        place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        s = place / (count[owner] - 1)
        return owner, start[owner] + s[:, None] * (end - start)[owner]

    def _wire_near(
        self,
        owner: Int[np.ndarray, " postures"],
        q: Float[np.ndarray, "postures joints"],
        margin: Float[np.ndarray, " ways"],
    ) -> Bool[np.ndarray, " postures"]:
        """Postures from which tip or middle of the bare wire come too near to a solid before the next one."""
        tip, R = self.clearance.cell.kinematics.tip(q, self.clearance.theta)
        near = np.zeros(len(q), dtype=bool)
        going, need = owner[1:] == owner[:-1], margin[owner]
        for point in (tip, tip - STICKOUT / 2 * R[:, :, 2]):
            start, end = point[:-1][going].T, point[1:][going].T
            for solid in self.clearance.solids:
                near[:-1][going] |= solid.segment(start, end) < need[:-1][going]
        return near


def astray(clear: Bool[np.ndarray, "touches touches"], blocked: Int[np.ndarray, "ways 2"]) -> Int[np.ndarray, " some"]:
    """Touches to give up so that an order without blocked ways may be found.

    Those outside the largest group that clear ways connect, and, of each blocked way of the order, the end with fewer
    clear ways. `blocked` holds the touches at both ends of each.
    """
    group = components(clear)
    main = np.argmax(np.bincount(group))
    outside = np.flatnonzero(group != main)
    degree = clear.sum(axis=1)
    ends = [int(min(pair, key=lambda i: (degree[i], i))) for pair in blocked.reshape(-1, 2)]
    return np.unique(np.concatenate([outside, np.array(ends, dtype=int)]))


def components(clear: Bool[np.ndarray, "touches touches"]) -> Int[np.ndarray, " touches"]:
    """The group of each touch: those that clear ways connect, directly or through others, share one."""
    group = np.arange(len(clear))
    while True:
        joined = np.where(clear, group, len(group)).min(axis=1)
        if np.array_equal(joined, group):
            return np.unique(group, return_inverse=True)[1]
        group = joined


def like(
    cell: Cell,
    some: Float[np.ndarray, "some joints"],
    bad: Float[np.ndarray, "bad joints"],
    good: Float[np.ndarray, "good joints"],
) -> Bool[np.ndarray, " some"]:
    """Poses that are nearer to a bad one than to any good one, by the time that joints take."""

    def nearest(to: np.ndarray) -> np.ndarray:
        out = np.full(len(some), np.inf)
        for q in to:
            np.minimum(out, np.abs((some - q) / cell.robot.speed).max(axis=1), out=out)
        return out

    return nearest(bad) < nearest(good)
