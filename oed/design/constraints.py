"""Which sets of touches are allowed: repeats, distances, quotas per face, a budget of time."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from oed.criteria.swaps import NEVER, Members

SMALL = 2000  # rows of a pool of which each is compared with each, once


@dataclass(frozen=True, eq=False)
class Rules:
    """The rules for the rows of one pool; None where there is none."""

    size: int  # of the pool
    repeats: bool = False  # whether a row may be taken twice
    face: Int[np.ndarray, " pool"] | None = None  # 0 ... faces - 1
    low: Int[np.ndarray, " faces"] | None = None
    high: Int[np.ndarray, " faces"] | None = None
    position: Float[np.ndarray, "pool axes"] | None = None
    distance: float = 0.0  # two touches are at least this far apart
    cost: Float[np.ndarray, " pool"] | None = None
    budget: float = np.inf

    @property
    def simple(self) -> bool:
        """Whether any set without repeats will do."""
        return self.face is None and self.position is None and self.cost is None

    def take(self, index: Int[np.ndarray, " some"]) -> "Rules":
        """The same rules for some of the rows."""
        parts = {
            name: value[index] for name in ("face", "position", "cost") if (value := getattr(self, name)) is not None
        }
        part = replace(self, size=len(index), **parts)
        if "_neighbours" in self.__dict__:
            part.__dict__["_neighbours"] = self._neighbours[np.ix_(index, index)]
        return part

    def near(self, members: Members) -> Bool[np.ndarray, "touches pool"]:
        """Which rows are too close to which members."""
        if self.size <= SMALL:
            return self._neighbours[members]
        return self._near(members)

    @cached_property
    def _neighbours(self) -> Bool[np.ndarray, "pool pool"]:
        return self._near(np.arange(self.size))

    def _near(self, members: Members) -> Bool[np.ndarray, "touches pool"]:
        assert self.position is not None
        square = np.einsum("ij,ij->i", self.position, self.position)
        apart = square[members][:, None] + square - 2 * self.position[members] @ self.position.T
        return apart < self.distance**2 * (1 - 1e-9)

    def counts(self, members: Members) -> Int[np.ndarray, " faces"]:
        """Touches on each face."""
        assert self.face is not None
        assert self.low is not None
        return np.bincount(self.face[members], minlength=len(self.low))

    def forbid(self, table: Float[np.ndarray, "touches pool"], members: Members) -> None:
        """Mark the swaps that would break a rule, in place."""
        if not self.repeats:
            table[:, members] = NEVER
        if self.face is not None and self.low is not None and self.high is not None:
            counts = self.counts(members)
            fits = ((counts > self.low)[:, None] & (counts < self.high)) | np.eye(len(counts), dtype=bool)
            if not fits.all():
                table[~fits[self.face[members]][:, self.face]] = NEVER
        if self.position is not None:
            near = self.near(members)
            crowded = np.flatnonzero(near.any(axis=0))
            near = near[:, crowded]
            table[:, crowded] = np.where(near.sum(axis=0) > near, NEVER, table[:, crowded])
        if self.cost is not None:
            room = self.budget * (1 + 1e-12) - self.cost[members].sum()
            table[self.cost - self.cost[members][:, None] > room] = NEVER

    def fitting(self, members: Members, n: int) -> Bool[np.ndarray, " pool"]:
        """Which rows may join a set that is to have n touches."""
        open_ = np.ones(self.size, bool)
        if not self.repeats:
            open_[members] = False
        if self.face is not None and self.low is not None and self.high is not None:
            counts = self.counts(members)
            missing = np.maximum(self.low - counts, 0)
            fits = (counts < self.high) & ((missing > 0) | (missing.sum() < n - len(members)))
            open_ &= fits[self.face]
        if self.position is not None and len(members):
            open_ &= ~self.near(members).any(axis=0)
        if self.cost is not None:
            open_ &= self.cost <= self.budget * (1 + 1e-12) - self.cost[members].sum()
        return open_

    def kept(self, members: Members, n: int) -> Members:
        """The members, in order, that break no rule together with those before them."""
        few, result = self.take(members), np.zeros(0, int)
        for k in range(len(members)):
            if len(result) < n and few.fitting(result, n)[k]:
                result = np.append(result, k)
        return members[result]
