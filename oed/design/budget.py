"""Exact designs over measurements of several rows and of different costs: the set that tells the most for a budget.

A measurement of cost c has the weight u = c w / budget in the relaxation, so that weights sum to one and none exceeds
its share of the budget: the bound of Kiefer and Wolfowitz is then that per cost. The search goes on excursions (DETMAX;
Mitchell 1974): some measurements join a set beyond the budget, and those leave whose loss per cost is least.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from oed.criteria.criteria import criterion_named
from oed.criteria.criterion import Criterion
from oed.design.matrix import checked, checked_prior, information
from oed.design.owners import Owners
from oed.design.relaxation import ApproximateDesign, approximate_design

GAP = 1e-3  # of the relaxation
SUPPORT = 1e-2  # of its largest weight, from which a measurement counts as used by the relaxation
POOL = 400  # measurements nearest to carrying weight that the search looks at
ROUNDING = 1e-9  # of the budget
EXCURSIONS = 400
LONGEST = 5  # measurements that join in one
LEAST = 1e-9  # of 1 - leverage
SLACK = 0.05  # of the logarithm, by which a set may be worse than the best (record-to-record travel; Dueck 1993)
POWERS = (0.0, 0.25, 0.5)  # of the cost by which further starts divide gains: kinds that cost more enter there
BLUR = 0.1  # of the logarithm of gains, for variety


@dataclass(frozen=True, eq=False)
class BudgetDesign:
    """Measurements to make, and their share of the best that any of the same budget could be worth."""

    members: Int[np.ndarray, " members"]  # indices of measurements, in increasing order
    cost: float
    value: float  # the criterion of these measurements and the prior
    efficiency: float  # against the bound of the relaxation, as a share of information; nan for O2 and O4
    relaxation: ApproximateDesign


def budget_design(
    rows: Float[np.ndarray, "rows parameters"],
    owner: Int[np.ndarray, " rows"],
    cost: Float[np.ndarray, " measurements"],
    budget: float,
    criterion: str | Criterion = "V",
    *,
    rng: np.random.Generator | None = None,
    prior: Float[np.ndarray, "parameters parameters"] | None = None,
    zone: np.ndarray | None = None,
    excursions: int = EXCURSIONS,
) -> BudgetDesign:
    """The measurements whose costs fit a budget and that are best by a criterion together with the prior.

    `owner` is the measurement of each whitened row, counting 0, 0, 0, 1, ...; no measurement is repeated. Raises
    ValueError if none fits.
    """
    rows, rng = checked(rows), np.random.default_rng(0) if rng is None else rng
    owners, cost = Owners.of(owner, len(rows)), np.asarray(cost, dtype=float)
    if cost.shape != (len(owners),) or not (cost > 0).all():
        raise ValueError(f"cost: expected one positive number for each of the {len(owners)} measurements")
    if cost.min() > budget:
        raise ValueError(f"budget: {budget:.6g} is less than the cheapest measurement costs, {cost.min():.6g}")
    before = checked_prior(prior, rows.shape[1])
    measure = criterion_named(criterion).on(zone, rows.shape[1])
    if cost.sum() <= budget:
        return _everything(rows, cost, before, measure)
    share = cost / budget
    scaled = rows / np.sqrt(owners.each(np.arange(len(owners)), share))[:, None]
    relaxed = approximate_design(scaled, measure, GAP, prior=before, cap=share, owner=owner)
    support = int((relaxed.weights > SUPPORT * share).sum())
    near = np.sort(np.argsort(-relaxed.closeness, kind="stable")[: max(POOL, 2 * support)])
    search = _Search(_blocks(rows, owners, near), cost[near], budget, measure, before)
    best = search.run(np.flatnonzero(relaxed.weights[near] >= 0.5 * share[near]), rng, excursions)
    members = near[best]
    M = before + information(rows[owners.rows(members)])
    value = float(measure.value(M, len(members)))
    return BudgetDesign(members, float(cost[members].sum()), value, measure.phi(M) / relaxed.level, relaxed)


def _everything(rows: np.ndarray, cost: np.ndarray, before: np.ndarray, criterion: Criterion) -> BudgetDesign:
    """All measurements, which the budget allows: nothing is better."""
    M, count = before + information(rows), len(cost)
    value = float(criterion.value(M, count))
    whole = ApproximateDesign(
        criterion.name, np.ones(count), value, value, 0.0, M, np.ones(count), criterion.phi(M), np.zeros_like(M), 1, 0
    )
    return BudgetDesign(np.arange(count), float(cost.sum()), value, 1.0, whole)


def _blocks(rows: np.ndarray, owners: Owners, some: Int[np.ndarray, " some"]) -> Float[np.ndarray, "some most p"]:
    """The rows of each measurement, filled up with zeros to as many as the largest has."""
    size = owners.size[some]
    out = np.zeros((len(some), int(size.max()), rows.shape[1]))
    place = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
    out[np.repeat(np.arange(len(some)), size), place] = rows[owners.rows(some)]
    return out


@dataclass(frozen=True, eq=False)
class _Search:
    """Measurements to choose from, and sets of them that fit the budget."""

    A: Float[np.ndarray, "pool most p"]
    cost: Float[np.ndarray, " pool"]
    budget: float
    criterion: Criterion
    before: Float[np.ndarray, "p p"]

    def run(self, start: Int[np.ndarray, " some"], rng: np.random.Generator, excursions: int) -> Int[np.ndarray, " n"]:
        """The best set found from some starts: each member replaced in turn until none helps, then excursions."""
        first = np.zeros(len(self.cost), dtype=bool)
        for i in start:
            first[i] = self.cost[first].sum() + self.cost[i] <= self.budget
        empty = np.zeros(len(self.cost), dtype=bool)
        starts = [(first, 1.0), *((empty, power) for power in POWERS)]
        sets = [self._each_in_turn(*self._completed(members, power)) for members, power in starts]
        best, level = max(sets, key=lambda entry: entry[1])
        here, height = best, level
        for k in range(excursions):
            new, value = self._excursion(here, rng)
            if value > level - SLACK * (1 - k / excursions):
                here, height = new, value
            if height > level:
                best, level = here, height
        return np.flatnonzero(self._each_in_turn(best, level)[0])

    def _each_in_turn(self, best: Bool[np.ndarray, " pool"], level: float) -> tuple[Bool[np.ndarray, " pool"], float]:
        improved = True
        while improved:
            improved = False
            for i in np.flatnonzero(best).tolist():
                new, value = self._completed(_fewer(best, i))
                if value > level + 1e-9:
                    best, level, improved = new, value, True
        return best, level

    def _excursion(
        self, members: Bool[np.ndarray, " pool"], rng: np.random.Generator
    ) -> tuple[Bool[np.ndarray, " pool"], float]:
        """The set after some joined it, and others left it until the budget is kept, each by a blurred look.

        What joins is judged by its gain alone or by that per cost: else kinds that cost more would never enter.
        """
        members, M = members.copy(), self.before + self._information(members)
        power = float(rng.integers(2))
        for _ in range(rng.integers(1, LONGEST + 1)):
            some = np.flatnonzero(~members)
            if len(some):
                k = some[np.argmax(_blur(rng, len(some)) * self._changes(M, some, 1.0) / self.cost[some] ** power)]
                members[k] = True
                M = M + self.A[k].T @ self.A[k]
        while self.cost[members].sum() > self.budget * (1 + ROUNDING):
            some = np.flatnonzero(members)
            k = some[np.argmin(_blur(rng, len(some)) * self._changes(M, some, -1.0) / self.cost[some])]
            members[k] = False
            M = self.before + self._information(members)
        return self._completed(members)

    def _completed(
        self, members: Bool[np.ndarray, " pool"], power: float = 1.0
    ) -> tuple[Bool[np.ndarray, " pool"], float]:
        """The set with what gains most per cost^power until nothing fits, and the logarithm of its criterion."""
        members, room = members.copy(), self.budget * (1 + ROUNDING) - self.cost[members].sum()
        M = self.before + self._information(members)
        while True:
            some = np.flatnonzero(~members & (self.cost <= room))
            if not len(some):
                return members, self.criterion.log(M)
            k = some[np.argmax(self._changes(M, some, 1.0) / self.cost[some] ** power)]
            members[k] = True
            room -= self.cost[k]
            M = M + self.A[k].T @ self.A[k]

    def _information(self, members: Bool[np.ndarray, " pool"]) -> Float[np.ndarray, "p p"]:
        return information(self.A[members].reshape(-1, self.A.shape[2]))

    def _changes(
        self, M: Float[np.ndarray, "p p"], some: Int[np.ndarray, " some"], sign: float
    ) -> Float[np.ndarray, " some"]:
        """By how much each measurement that joins (1) or leaves (-1) changes the logarithm of the criterion.

        Exact for one row by traces, and in the same order by D; for several rows they are taken one by one.
        """
        X = self.A[some].reshape(-1, len(M))
        slope = np.einsum("ij,ij->i", X @ self.criterion.slope(M), X)
        leverage = np.einsum("ij,ij->i", X @ np.linalg.inv(M), X)
        return np.asarray((slope / np.maximum(1 + sign * leverage, LEAST)).reshape(len(some), -1).sum(axis=1))


def _blur(rng: np.random.Generator, count: int) -> Float[np.ndarray, " count"]:
    return np.exp(BLUR * rng.standard_normal(count))


def _fewer(members: Bool[np.ndarray, " pool"], removed: int) -> Bool[np.ndarray, " pool"]:
    out = members.copy()
    out[removed] = False
    return out
