"""Candidates of several rows: a position has three, a pose six, a touch one; a weight counts for all rows of one."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class Owners:
    """Where the rows of each candidate stand: one after the other, candidates in their order."""

    size: Int[np.ndarray, " candidates"]  # rows of each

    @classmethod
    def single(cls, count: int) -> Self:
        """Candidates of one row each."""
        return cls(np.ones(count, dtype=int))

    @classmethod
    def of(cls, owner: Int[np.ndarray, " rows"], rows: int) -> Self:
        """Candidates by the number of the candidate of each row; raises ValueError if they do not count up by one."""
        owner = np.asarray(owner)
        if owner.shape != (rows,) or owner[0] != 0 or not np.isin(np.diff(owner), (0, 1)).all():
            raise ValueError(f"owner: expected a candidate for each of the {rows} rows, counting 0, 0, 1, 1, 1, 2, ...")
        return cls(np.bincount(owner))

    def __len__(self) -> int:
        return len(self.size)

    @cached_property
    def simple(self) -> bool:
        """Whether every candidate has one row."""
        return bool((self.size == 1).all())

    @cached_property
    def first(self) -> Int[np.ndarray, " candidates"]:
        """The first row of each candidate."""
        return np.cumsum(self.size) - self.size

    def rows(self, index: Int[np.ndarray, " some"]) -> Int[np.ndarray, " rows"]:
        """The rows of some candidates, in their order."""
        if self.simple:
            return index
        size = self.size[index]
        return np.repeat(self.first[index] - (np.cumsum(size) - size), size) + np.arange(size.sum())

    def each(self, index: Int[np.ndarray, " some"], values: Float[np.ndarray, " some"]) -> Float[np.ndarray, " rows"]:
        """Values of some candidates, one a row."""
        return values if self.simple else np.repeat(values, self.size[index])

    def summed(
        self, index: Int[np.ndarray, " some"] | None, values: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, " some"]:
        """Sums of values of rows over each of some candidates, or over each of all."""
        if self.simple:
            return values
        size = self.size if index is None else self.size[index]
        return np.add.reduceat(values, np.cumsum(size) - size)

    def local(self, index: Int[np.ndarray, " some"]) -> Int[np.ndarray, " rows"] | None:
        """The place of the candidate of each row among some; None if every candidate has one row."""
        return None if self.simple else np.repeat(np.arange(len(index)), self.size[index])
