"""Search over sets of touches: descents by single swaps, recombined.

Each member of a population is a local optimum of single swaps. The union of four of them is thinned to n touches,
improved by swaps until none helps, and takes the place of the worst member if it is better and new. The best sets of
one problem lie in basins thirty touches apart, with parts of the optimum in each; this joins them within a second,
where iterated local search and annealing stay in one. Children try the rows that some member uses, and the promising
ones all rows of the pool.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from oed.criteria.swaps import Members, Swaps
from oed.design.constraints import Rules

HEAT = 0.02  # variety when a union is thinned, in logarithm of the criterion
ENOUGH = 1e-7  # a gain below this, as a share of the criterion, is rounding in single precision
PARENTS = 4
PROMISING = 2e-4  # a child may be this much worse than the worst before it has tried all rows
SAME = 1e-9  # two sets whose logarithms differ by less are one
STALE = 2  # children a member without a better one, and a new population begins
ATTEMPTS = 20  # at building a set that keeps the rules


@dataclass(frozen=True, eq=False)
class LocalOptimum:
    """A set that no single swap improves."""

    members: Members
    log: float


@dataclass(frozen=True, eq=False)
class Pool:
    """Rows to choose n touches from, and the rules that a choice keeps."""

    swaps: Swaps
    rules: Rules
    n: int

    def among(self, index: Int[np.ndarray, " some"]) -> "Pool":
        """The same with some of the rows."""
        return Pool(self.swaps.among(index), self.rules.take(index), self.n)

    def descend(self, members: Members) -> LocalOptimum:
        """The set that is reached by making the best swap, again and again, while there is one that helps."""
        swaps = self.swaps
        swaps.load(members)
        for _ in range(20 * self.n):
            table = swaps.table()
            self.rules.forbid(table, swaps.members)
            a, j, ratio = swaps.best(table)
            if ratio > 1 + ENOUGH:
                swaps.swap(a, j)
            elif not swaps.look_wider():
                break
        reached = np.sort(swaps.members)
        return LocalOptimum(reached, swaps.log(reached))

    def thinned(self, members: Members, rng: np.random.Generator) -> Members | None:
        """N of the touches, chosen so that little is lost, then mended where they break a rule; None if that fails."""
        thinned = self.swaps.thinned(members, self.n, HEAT, rng)
        if self.rules.simple and len(thinned) == self.n:
            return thinned
        return self.completed(self.rules.kept(rng.permutation(thinned), self.n))

    def completed(self, members: Members) -> Members | None:
        """The touches and, up to n, the rows that add most and keep the rules; None if they run out."""
        while len(members) < self.n:
            fitting = self.rules.fitting(members, self.n)
            if not fitting.any():
                return None
            gains = self.swaps.gains(members)
            if self.rules.cost is not None:
                gains = gains / np.where(self.rules.cost > 0, self.rules.cost, 1)
            members = np.append(members, int(np.argmax(np.where(fitting, gains, -np.inf))))
        return members

    def first(self, rng: np.random.Generator) -> LocalOptimum | None:
        """A local optimum from a random start; None if no set that keeps the rules was found."""
        count = len(self.swaps.rows)
        few = min(3 * self.n, (self.n + count + 1) // 2)  # of a small pool not all, which would be one start for ever
        for _ in range(ATTEMPTS):
            members = self.thinned(rng.choice(count, min(few, count), replace=False), rng)
            if members is not None:
                return self.descend(members)
        return None

    def after(self, members: Members, rng: np.random.Generator) -> LocalOptimum | None:
        """A local optimum from as many touches of a set as keep the rules; None if there are none."""
        some = members if self.rules.simple else self.rules.kept(rng.permutation(members), self.n)
        whole = self.completed(some[: self.n]) if len(some) else None
        return None if whole is None else self.descend(whole)

    def child(self, parents: list[Members], rng: np.random.Generator) -> LocalOptimum | None:
        """A local optimum from the touches of others; None if they are all the same, or the rules leave none."""
        union = np.unique(np.concatenate(parents))
        if len(union) <= max(len(np.unique(members)) for members in parents):
            return None
        members = self.thinned(union, rng)
        return None if members is None else self.descend(members)


class Population:
    """Local optima that live together."""

    def __init__(self, pool: Pool, people: list[LocalOptimum]):
        self.pool, self.people = pool, people
        self.used = np.zeros(len(pool.swaps.rows), bool)
        for design in people:
            self.used[design.members] = True
        self._settle()

    def _settle(self) -> None:
        """Look again at which rows are in use."""
        self.rows = np.flatnonzero(self.used)
        self.small = self.pool.among(self.rows)

    def breed(self, rng: np.random.Generator) -> bool:
        """Let some have a child; whether it took the place of the worst."""
        parents = rng.choice(len(self.people), min(PARENTS, len(self.people)), replace=False)
        new = self.small.child([np.searchsorted(self.rows, self.people[k].members) for k in parents], rng)
        worst = min(range(len(self.people)), key=lambda k: self.people[k].log)
        if new is None or not self._welcome(new, self.people[worst].log - PROMISING):
            return False
        new = self.pool.descend(self.rows[new.members])
        if not self._welcome(new, self.people[worst].log):
            return False
        self.people[worst] = new
        self.used[new.members] = True
        if not np.isin(new.members, self.rows).all():
            self._settle()
        return True

    def _welcome(self, new: LocalOptimum, level: float) -> bool:
        """Whether a set is better than a level and unlike all others."""
        return new.log > level and all(abs(new.log - other.log) > SAME for other in self.people)


def evolve(
    pool: Pool, size: int, rng: np.random.Generator, progress: Callable[[int], float], start: Members | None = None
) -> tuple[list[LocalOptimum], int]:
    """The best sets, best first, and the searches made until `progress(searches)` says 1; none if the rules allow none.

    The first of all is completed from a `start` that is not empty. A population that has no better children any more
    makes room for a new one.
    """
    best: list[LocalOptimum] = []
    count = 0
    while progress(count) < 1 or not best:
        people: list[LocalOptimum] = []
        while len(people) < size and (progress(count) < 1 or not people):
            design = None if count or start is None else pool.after(start, rng)
            design = design or pool.first(rng)
            count += 1
            if design is None:
                return best, count
            people.append(design)
        population, since = Population(pool, people), 0
        while len(people) > 1 and progress(count) < 1 and since < STALE * size:
            since = 0 if population.breed(rng) else since + 1
            count += 1
        best += sorted(population.people, key=lambda design: -design.log)[:2]
    return sorted(best, key=lambda design: -design.log), count
