"""The strategies of planning: optimal, even and random, each from an offer to touches in the order of making them."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from identify.uncertainty.coordinates import Coordinates
from oed.candidates.baselines import even
from oed.candidates.candidates import Candidates
from oed.criteria.criterion import Criterion
from oed.planning.candidate_set import CandidateSet
from oed.planning.visitable import Best, Pick, expected, joined, linked, measured, resized, visited
from oed.refinement.certificate import Certificate, Manifold, generate_columns
from oed.refinement.coordinate import Refinement, refine, replaced
from probe.motion.tour import Order

STRATEGIES = ("optimal", "even", "random")
RETURNS = 8  # times that touches at ways which moving them has blocked are put back, each time more around them
SEARCHES = 40  # local ones for 50 touches that are refined then, fewer for more: they are nearer to the bound anyway
SWEEPS = 2  # of moving touches: a third gains nothing that counts in the time that a plan takes,
THOROUGH = 8  # but a little each time where more is given, until one gains nothing
FEWER = 16  # of them, where each compares sets by a criterion with kinks
PRICING = 0.3  # of the seconds that are given
EXCHANGE = 0.1  # of them
LATE = 0.8  # of them, after which no exchange begins
ENOUGH = 1e-3  # that exchange and refinement have to gain for others to follow
Say = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Choice:
    """Touches in the order of making them, and how near they are to the best."""

    touches: Candidates
    order: Order
    joined: int = 0  # touches on offer but those that no clear way was found to, where that was asked
    efficiency: float | None = None  # against the bound on these
    manifold: float | None = None  # against the bound on all touches, as far as they were priced
    certificate: Certificate | None = None  # that bound
    count: int = 0  # touches on offer, polished ones with them, where there are such


@dataclass(frozen=True, eq=False)
class Setting:
    """What a plan is to be: by which criterion, from which offer, how."""

    candidate_set: CandidateSet
    criterion: str
    strategy: str
    rng: np.random.Generator
    seconds: float | None = None  # for columns and exchange; None: as many rounds as a plan needs

    @property
    def coordinates(self) -> Coordinates:
        """Those of the criterion."""
        return self.candidate_set.coordinates(self.criterion)

    @cached_property
    def measure(self) -> Criterion:
        """The criterion, of the weld zone if it needs it."""
        return measured(self.criterion, self.candidate_set)

    def quickly(self, n: int) -> Candidates:
        """Touches as the strategy has them, not refined and not ordered."""
        everything = np.ones(len(self.candidate_set.candidates), dtype=bool)
        return self.candidate_set.candidates.take(self._pick(n)(everything, None))

    def resized(self, touches: Candidates, n: int) -> Candidates:
        """About what the strategy would choose, from touches of another number."""
        if self.strategy != "optimal":
            return self.quickly(n)
        return resized(Best(self.candidate_set, n, self.criterion), touches)

    def choose(self, n: int, say: Say) -> Choice:
        """Touches in an order; ways that cannot be kept clear are part of it."""
        if self.strategy != "optimal":
            say("choosing", 0.0)
            visit = visited(self.candidate_set, self._pick(n), self.rng)
            touches = self.candidate_set.candidates.take(visit.order.index)
            order = self._ordered(touches)
            return Choice(touches.take(order.index), order)
        return self._optimal(n, say)

    def _optimal(self, n: int, say: Say) -> Choice:
        """Column generation over the manifold, exchange, refinement; with `seconds` exchange and refinement again."""
        begin = time.perf_counter()
        say("choosing", 0.0)
        refinement = Refinement(self.coordinates, self.candidate_set.feasibility)
        manifold = self._columns(refinement, n, lambda share: say("pricing", 0.1 + 0.3 * share))
        certificate = manifold.certificate
        say("exchanging", 0.4)
        candidate_set = self.candidate_set.with_candidates(manifold.touches)
        seconds = None if self.seconds is None else self.seconds * EXCHANGE
        relaxation, searches = manifold.relaxation if self.measure.certified else None, self._searches(n)
        best = Best(candidate_set, n, self.criterion, searches=searches, seconds=seconds, relaxation=relaxation)
        visit = visited(candidate_set, expected(best), self.rng)
        bound, touches = best.bound(visit.allowed), candidate_set.candidates.take(visit.order.index)
        say("refining", 0.7)
        touches, order = self._refined(refinement, touches, lambda share: say("refining", 0.7 + 0.3 * share))
        while self.seconds is not None and time.perf_counter() - begin < LATE * self.seconds:
            better = self._again(
                refinement, candidate_set.with_candidates(manifold.touches.take(visit.allowed)), touches
            )
            if better is None:
                break
            touches, order = better
        phi = self._phi(touches)
        covered = phi / certificate.level if self.measure.certified else None
        efficiency = phi / bound.level if np.isfinite(bound.level) else None
        among, count = int(visit.allowed.sum()), len(self.candidate_set.candidates) + certificate.joined
        return Choice(touches, order, among, efficiency, covered, certificate, count)

    def _columns(self, refinement: Refinement, n: int, progress: Callable[[float], None]) -> Manifold:
        """The touches on offer that clear ways join, and polished ones."""
        pick = Best(self.candidate_set, n, self.criterion)
        allowed, core = linked(pick)
        return generate_columns(
            refinement,
            self.candidate_set.candidates.take(allowed),
            pick.rows[allowed],
            self.measure.relaxed,
            pick.bound(allowed),
            joined=lambda touches: joined(self.candidate_set, core, touches),
            seconds=None if self.seconds is None else self.seconds * PRICING,
            progress=progress,
        )

    def _again(
        self, refinement: Refinement, candidate_set: CandidateSet, touches: Candidates
    ) -> tuple[Candidates, Order] | None:
        """The touches exchanged with candidates and refined once more; None if that tells no more."""
        count, n = len(candidate_set.candidates), len(touches)
        candidate_set = candidate_set.with_candidates(candidate_set.candidates.followed_by(touches))
        pick = expected(Best(candidate_set, n, self.criterion, searches=self._searches(n)))
        start = np.arange(count, count + n)
        visit = visited(
            candidate_set, lambda allowed, before: pick(allowed, start if before is None else before), self.rng
        )
        better, order = self._refined(refinement, candidate_set.candidates.take(visit.order.index), lambda share: None)
        if order.blocked or self._phi(better) < self._phi(touches) * (1 + ENOUGH):
            return None
        return better, order

    def _searches(self, n: int) -> int:
        return SEARCHES * 50 // max(50, n) if self.measure.formula.exact else FEWER

    def _pick(self, n: int) -> Pick:
        candidate_set, rng = self.candidate_set, self.rng
        if self.strategy == "even":
            return lambda allowed, before: even(candidate_set.candidates, n, allowed)
        if self.strategy == "random":
            return lambda allowed, before: rng.choice(np.flatnonzero(allowed), n, replace=False)
        return expected(Best(candidate_set, n, self.criterion))

    def _refined(
        self, refinement: Refinement, touches: Candidates, say: Callable[[float], None]
    ) -> tuple[Candidates, Order]:
        """Touches moved to where they tell more, as far as the ways between them stay clear."""
        sweeps = SWEEPS if self.seconds is None else THOROUGH
        better = refine(refinement, touches, self.measure, sweeps=sweeps, progress=say)
        for around in range(1, RETURNS + 1):
            order = self._ordered(better, touches, kicks=0)  # so that the old ways back are still there
            if not order.blocked:
                shorter = self._ordered(better, touches)
                order = order if shorter.blocked else shorter
                return better.take(order.index), order
            ends = np.unique(
                np.concatenate([order.index[max(0, i + 1 - around) : i + 1 + around] for i in order.blocked])
            )
            better = replaced(better, ends, touches.take(ends))
        order = self._ordered(touches)
        return touches.take(order.index), order

    def _ordered(self, touches: Candidates, above: Candidates | None = None, kicks: int | None = None) -> Order:
        """A short order of touches, which are in a good one already."""
        return self.candidate_set.visit(touches, self.rng, kicks, start=np.arange(len(touches)), above=above)[0]

    def _phi(self, touches: Candidates) -> float:
        """The criterion of touches and what is known before, of degree one in the information."""
        rows = self.coordinates.rows(touches.expected_rows(self.candidate_set.cell))
        return self.measure.phi(self.coordinates.information(rows))
