"""Exact designs: the n touches that tell the most, chosen among all candidates.

The search (`oed.design.memetic`) is among the touches that the relaxation nearly uses; what it finds is then improved
by swaps with every candidate there is, and the relaxation's bound says how much better any set could be.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from oed.criteria.criterion import Criterion
from oed.criteria.swaps import Members, Precision, Swaps
from oed.design.matrix import blocks, information, whitener
from oed.design.memetic import LocalOptimum, Pool, evolve
from oed.design.problem import DesignProblem, design_problem
from oed.design.relaxation import ApproximateDesign

CLOSE = 0.95  # candidates whose gain is this close to what weight needs make the pool,
POOL = 500, 1500  # so many rows at the least and at the most, more for many touches
RIDGE = 1e-9  # of the information of the relaxation, so that any set has an inverse
ROUNDING = 1e-6  # of an efficiency of one
CHUNK = 4096  # candidates compared with a set at once
FINAL = 3  # sets of the search that are compared with every candidate
PASSES = 50  # of that comparison; 2 to 5 are usual
SMALLEST = 6  # population
SEARCHES = 12  # for each member of a population, where so many rows are close;
CLOSE_ROWS = 800  # with fewer the searches fall as their square: good sets are fewer, and chance finds one sooner,
CHEAP = 25  # but not below that of a pool of so many rows, in which a search costs next to nothing


@dataclass(frozen=True, eq=False)
class ExactDesign:
    """Touches to make, their worth, and their share of the best that any touches could be worth."""

    criterion: str
    """Its name."""
    indices: Members
    """Rows; the fixed ones first."""
    value: float
    """The criterion of these touches and the prior."""
    efficiency: float
    """Against the bound of `relaxation`, as a share of information; nan for O2 and O4."""
    relaxation: ApproximateDesign
    """The weights and the bound that the touches are measured by."""
    searches: int
    """Local searches made."""

    def __repr__(self) -> str:
        return (
            f"<{len(self.indices)} rows by {self.criterion}: {self.value:.6g}, "
            f"at least {100 * self.efficiency:.1f} % of the best possible, after {self.searches} searches>"
        )


def exact_design(
    rows: Float[np.ndarray, "candidates parameters"],
    n: int | None = None,
    criterion: str | Criterion = "D",
    *,
    rng: np.random.Generator | None = None,
    seconds: float | None = None,
    iterations: int | None = None,
    relaxation: ApproximateDesign | None = None,
    prior: Float[np.ndarray, "parameters parameters"] | None = None,
    zone: np.ndarray | None = None,
    fixed: Int[np.ndarray, " fixed"] | None = None,
    start: Int[np.ndarray, " some"] | None = None,
    face: np.ndarray | None = None,
    quotas: Mapping[Any, tuple[int, int]] | None = None,
    positions: Float[np.ndarray, "candidates axes"] | None = None,
    min_distance: float = 0.0,
    repeats: bool = False,
    cost: Float[np.ndarray, " candidates"] | None = None,
    budget: float | None = None,
) -> ExactDesign:
    """The n touches, `fixed` ones included, that are best by a criterion; or as many as fit a `budget` of `cost`.

    `quotas` are the smallest and largest number of touches per `face` (a number or a name); no two touches are closer
    than `min_distance` in `positions`. The search begins with a set completed from `start`, as far as that keeps the
    rules. It makes `iterations` local searches, as many as the problem needs if not given, and is the same for the same
    `rng`; more of them live in a larger population, so that a single run may end lower. With `seconds` it goes on until
    they are over, and what it finds depends on the machine; with both, until so many searches are made and the seconds
    are over.
    """
    problem = design_problem(
        rows,
        n,
        criterion,
        prior=prior,
        zone=zone,
        fixed=fixed,
        face=face,
        quotas=quotas,
        positions=positions,
        min_distance=min_distance,
        repeats=repeats,
        cost=cost,
        budget=budget,
    )
    rng = np.random.default_rng(0) if rng is None else rng
    relaxation = problem.relaxed(repeats) if relaxation is None else relaxation
    level, M = _scaled(problem, relaxation)
    basis = whitener(M)
    least = iterations or 0
    size, iterations = _effort(problem, relaxation.closeness, iterations)
    begin = np.zeros(0, int) if start is None else np.intersect1d(start, problem.free)
    progress = _progress(seconds, iterations if seconds is None else least)
    best_sets, searches = _searched(problem, relaxation.closeness, basis, size, rng, progress, begin)
    best = max((_polished(problem, basis, ids) for ids in best_sets), key=lambda winner: winner.log)
    return _design(problem, best.members, relaxation, searches, level)


def _design(
    problem: DesignProblem,
    members: Int[np.ndarray, " members"],
    relaxation: ApproximateDesign,
    searches: int,
    level: float,
) -> ExactDesign:
    """The design of the best members, by the total information, prior and fixed touches included."""
    fresh = members[members < len(problem.rows)]
    indices = np.concatenate([problem.fixed, fresh])
    total = problem.before + information(problem.rows[fresh])
    value = float(problem.criterion.value(total, len(indices)))
    efficiency = problem.criterion.phi(total) / level
    if efficiency > 1 + ROUNDING:
        raise ValueError(
            f"{problem.criterion.name}: a design is {efficiency:.3f} times as good as its bound; the relaxation is of "
            "another problem, or value, slope and degree of the criterion do not agree"
        )
    return ExactDesign(
        criterion=problem.criterion.name,
        indices=indices,
        value=value,
        efficiency=efficiency,
        relaxation=relaxation,
        searches=searches,
    )


def _effort(
    problem: DesignProblem, closeness: Float[np.ndarray, " candidates"], iterations: int | None
) -> tuple[int, int]:
    """Members of a population, and local searches: fewer for many touches, which are nearer to the bound anyway."""
    formula = problem.criterion.formula
    size = max(SMALLEST, formula.population * 50 // max(50, problem.slots))
    if iterations is None:
        share = min(1.0, max((_close(problem, closeness) / CLOSE_ROWS) ** 2, CHEAP / len(problem.free)))
        share = share if formula.exact else 1.0  # a few swaps are looked at, and chance finds less
        iterations = int(np.ceil(size * SEARCHES * share))
    if iterations < 1:
        raise ValueError(f"iterations: {iterations}, expected at least 1")
    return min(size, max(SMALLEST, iterations // 10)), iterations


def _close(problem: DesignProblem, closeness: Float[np.ndarray, " candidates"]) -> int:
    """Rows that the relaxation uses or nearly uses."""
    return int((closeness[problem.free[problem.free < len(problem.rows)]] >= CLOSE).sum())


def _progress(seconds: float | None, iterations: int) -> Callable[[int], float]:
    """The share of the search that is over, after so many local searches."""
    if seconds is not None and not seconds > 0:
        raise ValueError(f"seconds: {seconds:g}, expected more than 0")
    begin = time.perf_counter()

    def share(count: int) -> float:
        time_share = 1.0 if seconds is None else (time.perf_counter() - begin) / seconds
        return min(time_share, count / iterations) if iterations else time_share

    return share


def _scaled(problem: DesignProblem, relaxation: ApproximateDesign) -> tuple[float, Float[np.ndarray, "p p"]]:
    """Bound and information of a relaxation, for the number of touches that is asked for."""
    if len(relaxation.weights) != len(problem.rows) or relaxation.criterion != problem.criterion.name:
        raise ValueError(
            f"relaxation: of {len(relaxation.weights)} candidates and criterion '{relaxation.criterion}', expected "
            f"{len(problem.rows)} and '{problem.criterion.name}'; make it from the same rows"
        )
    if problem.rules.cost is not None or relaxation.touches == problem.slots:
        return relaxation.level, relaxation.information
    if problem.before.any():
        raise ValueError(
            f"relaxation: made for {relaxation.touches} touches, expected {problem.slots}, since something is known "
            "already; pass touches= and prior= when making it"
        )
    more = problem.slots / relaxation.touches
    return more * relaxation.level, more * relaxation.information


def swaps_of(
    criterion: Criterion,
    rows: Float[np.ndarray, "some p"],
    before: Float[np.ndarray, "p p"],
    basis: Float[np.ndarray, "p p"] | None = None,
    precision: Precision = np.float32,
) -> Swaps:
    """Swaps among some rows beside information that is known.

    In the `basis`, by default that of all rows together, information is about a multiple of one: single precision is
    enough then.
    """
    T = whitener(before + information(rows)) if basis is None else basis
    return criterion.in_basis(T).swaps(rows @ T, T.T @ before @ T, precision)


def _swaps(problem: DesignProblem, basis: Float[np.ndarray, "p p"], ids: Int[np.ndarray, " some"]) -> Swaps:
    """Swaps among some rows of the problem."""
    back = np.linalg.inv(basis)
    before = problem.before + RIDGE * back.T @ back
    precision: Precision = np.float32 if problem.slots + len(problem.fixed) > len(basis) else np.float64
    return swaps_of(problem.criterion, problem.taken(ids), before, basis, precision)


def _pool(problem: DesignProblem, closeness: Float[np.ndarray, " candidates"], many: int) -> Int[np.ndarray, " pool"]:
    """The rows that the relaxation uses or nearly uses, and the empty ones."""
    real = problem.free < len(problem.rows)
    free = problem.free[real]
    if len(free) > many:
        free = free[np.argpartition(-closeness[free], many)[:many]]
    return np.concatenate([np.sort(free), problem.free[~real]])


def _searched(
    problem: DesignProblem,
    closeness: np.ndarray,
    basis: np.ndarray,
    size: int,
    rng: np.random.Generator,
    progress: Callable[[int], float],
    begin: Members,
) -> tuple[list[Members], int]:
    """The best sets of a search in a pool, from a beginning of a set; in a larger one where the rules leave none."""
    many = max(5 * problem.slots, int(np.clip(_close(problem, closeness), *POOL)))
    while True:
        ids = np.union1d(_pool(problem, closeness, many), begin)
        pool = Pool(_swaps(problem, basis, ids), problem.rules.take(ids), problem.slots)
        sets, searches = evolve(pool, size, rng, progress, np.searchsorted(ids, begin))
        if sets:
            return [ids[one.members] for one in sets[:FINAL]], searches
        if many >= len(problem.free):
            raise ValueError(
                f"rules: found no set of {problem.slots} touches that keeps quotas, distance and budget; loosen one"
            )
        many *= 8


def _polished(problem: DesignProblem, basis: np.ndarray, ids: Members) -> LocalOptimum:
    """The set after swaps with every candidate, until no single one helps."""
    best: LocalOptimum | None = None
    for _ in range(PASSES):
        newcomers = _newcomers(problem, basis, ids)
        local = np.concatenate([ids, newcomers])
        pool = Pool(_swaps(problem, basis, local), problem.rules.take(local), len(ids))
        optimum = pool.descend(np.arange(len(ids)))
        optimum = LocalOptimum(np.sort(local[optimum.members]), optimum.log)
        if best is not None and optimum.log <= best.log + 1e-12:
            return best
        best, ids = optimum, optimum.members
        if not len(newcomers):
            break
    assert best is not None
    return best


def _newcomers(problem: DesignProblem, basis: np.ndarray, ids: Members) -> Int[np.ndarray, " some"]:
    """The candidates that, for some touch, are the best to take its place."""
    everyone = problem.free if problem.rules.repeats else np.setdiff1d(problem.free, ids)
    if not len(everyone):
        return everyone
    n, seats = len(ids), np.arange(len(ids))
    best, who = np.full(n, -np.inf), np.full(n, -1)
    for block in blocks(len(everyone), CHUNK):
        local = np.concatenate([ids, everyone[block]])
        swaps = _swaps(problem, basis, local)
        swaps.load(seats)
        table = swaps.table()
        problem.rules.take(local).forbid(table, seats)
        top = table[:, n:].argmax(axis=1)
        value = table[seats, n + top]
        better = value > best
        best[better], who[better] = value[better], everyone[block][top[better]]
    return np.unique(who[best > swaps.still])
