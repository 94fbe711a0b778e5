"""The ways between touches: straight in joint space, clear of jig and arm, and touches that none leads to."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from oed.clearance import CLEAR, MARGIN, Clearance
from oed.sequence import between
from oed.torch import STICKOUT

SAMPLES = 17  # postures of a way that are checked for clearance
FINE = 33  # points of a way at which the tip is looked at: the bare wire is thin


@dataclass(frozen=True, eq=False)
class Ways:
    """Which straight ways in joint space are clear."""

    clearance: Clearance

    def clear(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"]
    ) -> Bool[np.ndarray, " ways"]:
        """Ways on which arm and torch keep half the usual margin and the bare wire stays out of the solid boxes."""
        ok = self._wire_outside(start, end)
        left = np.flatnonzero(ok)
        q = between(start[left], end[left], SAMPLES)
        hits = self.clearance.hits(q.reshape(-1, q.shape[2]), margin=MARGIN / 2).reshape(q.shape[:2])
        ok[left] = np.all(hits == CLEAR, axis=1)
        return ok

    def among(self, q: Float[np.ndarray, "poses joints"]) -> Bool[np.ndarray, "poses poses"]:
        """Between every two poses."""
        a, b = np.triu_indices(len(q), 1)
        out = np.eye(len(q), dtype=bool)
        out[a, b] = out[b, a] = self.clear(q[a], q[b])
        return out

    def _wire_outside(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"]
    ) -> Bool[np.ndarray, " ways"]:
        cell = self.clearance.cell
        q = between(start, end, FINE)
        tip, R = cell.kinematics.tip(q.reshape(-1, q.shape[2]), self.clearance.theta)
        out = np.ones(len(q), dtype=bool)
        for point in (tip, tip - STICKOUT / 2 * R[:, :, 2]):
            for box in () if cell.jig is None else cell.jig.boxes:
                inside: Bool[np.ndarray, " samples"] = np.all((point > box.lower) & (point < box.upper), axis=1)
                out &= ~inside.reshape(len(q), FINE).any(axis=1)
        return out


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
