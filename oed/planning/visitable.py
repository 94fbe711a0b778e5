"""Choose touches from an offer: the best of them that the robot can also visit one after the other."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.uncertainty.coordinates import Coordinates
from oed.candidates.candidates import SURELY, Candidates
from oed.candidates.hits import Outcome
from oed.criteria.criteria import criterion_named
from oed.criteria.criterion import Criterion
from oed.design.constraints import Rules
from oed.design.exact import exact_design, swaps_of
from oed.design.matrix import sensitivities
from oed.design.memetic import Pool
from oed.design.relaxation import ApproximateDesign, approximate_design
from oed.design.robust import RobustSwaps
from oed.planning.candidate_set import CandidateSet
from oed.refinement.coordinate import APART
from probe.motion.edges import COARSE, astray, like
from probe.motion.tour import Order

GAP = 3e-3  # of the relaxation: its bound holds at any gap
FEW = 6  # local searches, where touches are chosen again and again
SUPPORT = 60  # touches of the relaxation that are asked whether clear ways join them
POOL = 400  # touches that an exchange over several robots looks at
ROBOTS = 48  # of them
AVERAGE = 1.0  # times all of these together, that the average robot counts beside them
TRIES = 4  # of choosing again where the chosen cannot be visited
MENDS = 6  # of replacing what cannot be visited
LOOKS = 30  # at touches that tell nearly the same
IN_REACH = 0.2  # share of the touches that the robot reaches from where it stands, below which it has to be jogged
NEIGHBOURS = 4  # clear ways to others that make a touch likely to find its place in an order

Pick = Callable[[Bool[np.ndarray, " touches"], Int[np.ndarray, " n"] | None], Int[np.ndarray, " n"]]


@dataclass(frozen=True, eq=False)
class Visit:
    """Touches on offer that can be visited one after the other."""

    order: Order  # its index counts through the offer
    allowed: Bool[np.ndarray, " touches"]  # of the offer: those that do not lead to blocked ways, as far as was seen


def visited(candidate_set: CandidateSet, pick: Pick, rng: np.random.Generator) -> Visit:
    """Touches that `pick` chooses, until they can be visited on clear ways.

    What leads to blocked ways, or lets the arm of a robot that may be the real one hit something, is given up, with all
    that is more like it than like what stays; after some tries, it is put in the place of what is given up that tells
    nearly the same and can be visited. The best try is returned where none is free of blocked ways.
    """
    cell, at = candidate_set.cell, candidate_set.candidates.approach
    allowed = np.ones(len(at), dtype=bool)
    members, best, least = pick(allowed, None), None, 0
    for attempt in range(TRIES + MENDS):
        chosen = candidate_set.candidates.take(members)
        order, clear = candidate_set.visit(chosen, rng, kicks=0)
        away = _away(candidate_set.groups(chosen), np.ones(len(members))) | ~candidate_set.spares_arms(chosen)
        if best is None or len(order.blocked) + away.sum() < least:
            best, least = Visit(replace(order, index=members[order.index]), allowed), len(order.blocked) + away.sum()
        if not least:
            break
        bad = astray(clear, np.array([order.index[[i, i + 1]] for i in order.blocked], dtype=int))
        bad = np.union1d(bad, np.flatnonzero(away))
        good = np.setdiff1d(np.arange(len(members)), bad)
        fewer = allowed & ~like(cell, at, at[members[bad]], at[members[good]])
        if fewer.sum() < len(members):
            break
        allowed = fewer
        members = pick(allowed, members) if attempt < TRIES else _mended(candidate_set, members, bad, allowed)
    assert best is not None
    return best


def linked(best: "Best") -> tuple[Bool[np.ndarray, " touches"], Candidates]:
    """The touches on offer without those that no clear way seems to join to most of what the relaxation uses.

    Returned with those of it that clear ways join.
    """
    candidate_set, n = best.candidate_set, best.n
    cell, at, allowed = (
        candidate_set.cell,
        candidate_set.candidates.approach,
        np.ones(len(candidate_set.candidates), dtype=bool),
    )
    for _ in range(TRIES):
        weights = best.bound(allowed).weights
        some = np.argsort(-weights, kind="stable")[:SUPPORT]
        support = np.flatnonzero(allowed)[some]
        group = candidate_set.groups(candidate_set.candidates.take(support))
        main = ~_away(group, weights[some])
        fewer = allowed & ~like(cell, at, at[support[~main]], at[support[main]])
        if main.all() or fewer.sum() < n:
            break
        allowed = fewer
    return allowed, candidate_set.candidates.take(support[main])


def _away(group: Int[np.ndarray, " some"], weight: Float[np.ndarray, " some"]) -> Bool[np.ndarray, " some"]:
    """Touches out of reach from where the robot stands; from most of the weight, where hardly any is in reach."""
    carried = np.bincount(group, weight)
    main = 0 if carried[0] > IN_REACH * carried.sum() else np.argmax(carried)
    return np.asarray(group != main)


def joined(candidate_set: CandidateSet, core: Candidates, touches: Candidates) -> Bool[np.ndarray, " touches"]:
    """Which touches clear ways seem to join to most of a core."""
    if not len(touches):
        return np.zeros(0, dtype=bool)
    group = candidate_set.groups(core.followed_by(touches))
    return np.asarray(group[len(core) :] == np.argmax(np.bincount(group[: len(core)])))


def _mended(
    candidate_set: CandidateSet,
    members: Int[np.ndarray, " n"],
    bad: Int[np.ndarray, " some"],
    allowed: Bool[np.ndarray, " touches"],
) -> Int[np.ndarray, " n"]:
    """The touches with those that lead astray replaced by others that tell nearly the same and have clear ways."""
    at, coordinates = candidate_set.candidates.approach, candidate_set.all_unknowns
    rest = np.delete(members, bad)
    F = candidate_set.rows @ coordinates.basis
    F = F @ np.linalg.cholesky(np.linalg.inv(coordinates.information(F[members])))  # so that distances mean information
    for i in members[bad]:
        distance = np.minimum(((F - F[i]) ** 2).sum(axis=1), ((F + F[i]) ** 2).sum(axis=1))
        distance[~allowed] = np.inf
        distance[rest] = np.inf
        near = np.argsort(distance, kind="stable")[:LOOKS]
        pairs = np.array([[a, b] for a in near for b in rest])
        clear = (
            candidate_set.edges.clear(at[pairs[:, 0]], at[pairs[:, 1]], COARSE)
            .reshape(len(near), len(rest))
            .sum(axis=1)
        )
        rest = np.append(rest, near[int(np.argmax(clear >= min(NEIGHBOURS, clear.max())))])
    return rest


@dataclass(frozen=True, eq=False)
class Best:
    """Choose what is best by a criterion: searched for among what the relaxation nearly uses, then among all.

    `tip` holds the rows of the points that are to be exact, by all unknowns, those of the tip in the weld zone if not
    given; `searches` are local ones, fewer where touches have to be chosen again; with `seconds` the first choice takes
    so long. `relaxation` is that of all touches on offer, where it is known.
    """

    candidate_set: CandidateSet
    n: int
    criterion: str | Criterion
    tip: Float[np.ndarray, "poses 3 unknowns"] | None = None
    searches: int = FEW
    seconds: float | None = None
    relaxation: ApproximateDesign | None = None

    def __call__(
        self, allowed: Bool[np.ndarray, " touches"], before: Int[np.ndarray, " n"] | None
    ) -> Int[np.ndarray, " n"]:
        """N of those allowed; `before` are touches to begin with, as far as they are."""
        some = np.flatnonzero(allowed)
        if before is None and not self.measure.certified:  # swaps alone would stick far from the best
            before = replace(self, criterion=self.measure.relaxed)(allowed, None)
        start = None if before is None else np.searchsorted(some, np.intersect1d(before, some))
        searches = self.searches if before is None else min(self.searches, FEW)
        seconds = self.seconds if before is None else None
        design = exact_design(
            self.rows[some],
            self.n,
            self.measure,
            relaxation=self.bound(allowed),
            start=start,
            iterations=searches,
            seconds=seconds,
            prior=self.coordinates.precision,
            positions=_places(self.candidate_set.candidates)[some],
            min_distance=1.0,
        )
        return some[design.indices]

    def bound(self, allowed: Bool[np.ndarray, " touches"]) -> ApproximateDesign:
        """The best weights on touches, and the bound that they give."""
        name, start = allowed.tobytes(), None
        if name not in self._bounds:
            if self._bounds:
                before, design = next(reversed(self._bounds.items()))
                start = np.zeros(len(allowed))
                start[np.frombuffer(before, bool)] = design.weights
                start = start[allowed]
            self._bounds[name] = approximate_design(
                self.rows[allowed], self.measure, GAP, touches=self.n, prior=self.coordinates.precision, start=start
            )
        return self._bounds[name]

    @cached_property
    def _bounds(self) -> dict[bytes, ApproximateDesign]:
        """By the touches that are allowed."""
        every = np.ones(len(self.candidate_set.candidates), dtype=bool).tobytes()
        return {} if self.relaxation is None else {every: self.relaxation}

    @property
    def coordinates(self) -> Coordinates:
        """Those of the criterion."""
        return self.candidate_set.coordinates(self.criterion)

    @cached_property
    def rows(self) -> Float[np.ndarray, "touches k"]:
        """Whitened rows of all candidates in these coordinates."""
        return self.candidate_set.rows @ self.coordinates.basis

    @cached_property
    def measure(self) -> Criterion:
        """The criterion, of what is to be exact."""
        return measured(self.criterion, self.candidate_set, self.tip)


def measured(
    criterion: str | Criterion, candidate_set: CandidateSet, tip: Float[np.ndarray, "poses 3 unknowns"] | None = None
) -> Criterion:
    """A criterion of the poses of the weld zone, or of points with other rows, if it needs any."""
    formula, coordinates = criterion_named(criterion), candidate_set.coordinates(criterion)
    zone = coordinates.of_tip(candidate_set.tip if tip is None else tip) if formula.needs_zone else None
    return formula.on(zone, len(coordinates))


def expected(best: Best) -> Pick:
    """Choose what is best on average over robots drawn from what is known, each of which misses other touches.

    The search begins with what is best for the information of the average robot, or with the touches before that are
    still allowed, and swaps touches for those that would gain most, by the mean logarithm of the criterion; a touch
    tells a robot that misses it nothing. The average robot counts with them, so that touches are not chosen for the
    luck of a draw.
    """
    candidate_set, coordinates = best.candidate_set, best.coordinates

    def pick(allowed: Bool[np.ndarray, " touches"], before: Int[np.ndarray, " n"] | None) -> Int[np.ndarray, " n"]:
        start = best(allowed, None) if before is None else before[allowed[before]]
        gains = swaps_of(best.measure, best.rows, coordinates.precision).gains(start)
        some = np.argsort(-np.where(allowed, gains, -np.inf), kind="stable")[: min(POOL, int(allowed.sum()))]
        pool = np.union1d(start, some)
        members = np.searchsorted(pool, start)
        search = _over_robots(best, candidate_set.candidates.take(pool), members)
        whole = search.completed(members)
        return best(allowed, before) if whole is None else pool[search.descend(whole).members]

    return pick


def resized(best: Best, touches: Candidates) -> Candidates:
    """Touches of which those go that robots drawn from what is known miss least, or which others join that tell most.

    One after the other, and none is exchanged: about what `expected` would choose.
    """
    candidate_set, n, members = best.candidate_set, best.n, np.arange(len(touches))
    if n > len(touches):
        rows = best.coordinates.rows(touches.expected_rows(candidate_set.cell))
        S = best.measure.slope(best.coordinates.information(rows))
        gains = sensitivities(best.rows, S)
        touches = touches.followed_by(candidate_set.candidates.take(np.argsort(-gains, kind="stable")[:POOL]))
    search = _over_robots(best, touches, members)
    while len(members) > n:
        members = np.delete(members, np.argmin(search.swaps.losses(members)))
    whole = search.completed(members)
    return touches.take(members if whole is None else whole)


def _over_robots(best: Best, touches: Candidates, start: Int[np.ndarray, " some"]) -> Pool:
    """Sets of some touches, judged by robots drawn from what is known, and by the average robot beside them."""
    coordinates, rules = best.coordinates, Rules(len(touches), position=_places(touches), distance=1.0)
    met = touches.hits.outcomes(touches.face, touches.q, touches.hits.robots(ROBOTS)) == Outcome.MEETS
    rows = coordinates.rows(touches.expected_rows(best.candidate_set.cell, SURELY - 1))
    few = met[:, start].sum(axis=1).min() <= len(coordinates)  # single precision would lose what they tell
    precision = np.float64 if few else np.float32
    swaps = [swaps_of(best.measure, rows * hit[:, None], coordinates.precision, None, precision) for hit in met]
    mean = coordinates.rows(touches.expected_rows(best.candidate_set.cell))
    average = swaps_of(best.measure, mean, coordinates.precision, None, precision)
    return Pool(RobustSwaps([*swaps, average], [*np.ones(ROBOTS), AVERAGE * ROBOTS]), rules, best.n)


def _places(touches: Candidates) -> Float[np.ndarray, "touches axes"]:
    """Places of touches in units in which replicates are closer than 1."""
    return np.hstack([touches.point / APART[0], touches.q / APART[1]])
