"""The ways between touches: straight in joint space, clear of jig and arm; an order along them; touches off them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.descent import LEVER
from identify.model.touch import Plan
from oed.clearance import CLEAR, MARGIN, Clearance
from oed.judgement import WIRE
from oed.sequence import Order, order
from oed.torch import STICKOUT

COARSE = 0.2  # [rad] a joint may turn between two postures that are looked at, of ways that could be taken
FINE = 0.03  # [rad], of ways that are taken: what swings half a metre moves less than a nozzle is thick


@dataclass(frozen=True, eq=False)
class Ways:
    """Which straight ways in joint space are clear."""

    clearance: Clearance

    def clear(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"], step: float = FINE
    ) -> Bool[np.ndarray, " ways"]:
        """Ways on which arm and torch keep half the usual margin, and the bare wire, between looks too, its own."""
        ok = np.ones(len(start), dtype=bool)
        owner, q = self._postures(start, end, step)
        if not len(owner):
            return ok
        ok[owner[self._wire_near(owner, q)]] = False
        left = np.flatnonzero(ok[owner])
        ok[owner[left[self.clearance.hits(q[left], margin=MARGIN / 2) != CLEAR]]] = False
        return ok

    def among(self, q: Float[np.ndarray, "poses joints"]) -> Bool[np.ndarray, "poses poses"]:
        """Ways between every two poses that seem clear at a coarse look."""
        a, b = np.triu_indices(len(q), 1)
        out = np.eye(len(q), dtype=bool)
        out[a, b] = out[b, a] = self.clear(q[a], q[b], COARSE)
        return out

    def order(
        self,
        cell: Cell,
        plan: Plan,
        rng: np.random.Generator,
        kicks: int | None = None,
        *,
        start: Int[np.ndarray, " touches"] | None = None,
    ) -> tuple[Order, Bool[np.ndarray, "touches touches"]]:
        """A short order along clear ways, each looked at finely, and which ways were taken for clear.

        Never longer than `start`, nor blocked where that is not.
        """
        clear = self.among(plan.approach)
        sure = np.zeros_like(clear)
        before = start
        while True:
            found = order(cell, plan, clear, rng, start=before, kicks=kicks)
            before, kicks = found.index if start is None else start, 0
            a, b = found.index[:-1], found.index[1:]
            new = np.flatnonzero(clear[a, b] & ~sure[a, b])
            fine = self.clear(plan.approach[a[new]], plan.approach[b[new]])
            a, b = a[new], b[new]
            clear[a, b] = clear[b, a] = fine
            sure[a, b] = sure[b, a] = True
            if fine.all():
                return found, clear

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
        self, owner: Int[np.ndarray, " postures"], q: Float[np.ndarray, "postures joints"]
    ) -> Bool[np.ndarray, " postures"]:
        """Postures from which tip or middle of the bare wire come too near to a solid before the next one."""
        tip, R = self.clearance.cell.kinematics.tip(q, self.clearance.theta)
        near = np.zeros(len(q), dtype=bool)
        going = owner[1:] == owner[:-1]
        for point in (tip, tip - STICKOUT / 2 * R[:, :, 2]):
            start, end = point[:-1][going].T, point[1:][going].T
            for solid in self.clearance.solids:
                near[:-1][going] |= solid.segment(start, end) < WIRE
        return near


def astray(clear: Bool[np.ndarray, "touches touches"], blocked: Int[np.ndarray, " ways"]) -> Int[np.ndarray, " some"]:
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
