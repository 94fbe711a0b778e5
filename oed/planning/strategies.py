"""The strategies of planning: optimal, even and random, each from an offer to touches in the order of making them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from identify.uncertainty.coordinates import Coordinates
from oed.candidates.candidates import Candidates
from oed.candidates.even import even
from oed.criteria.criterion import Criterion
from oed.design.relaxation import ApproximateDesign
from oed.planning.candidate_set import CandidateSet
from oed.planning.visitable import Best, Pick, linked, measured, robust, visited
from oed.refinement.certificate import certify
from oed.refinement.coordinate import Refinement, refine, replaced
from probe.motion.tour import Order

STRATEGIES = ("optimal", "even", "random")
RETURNS = 8  # times that touches at ways which moving them has blocked are put back, each time more around them
SEARCHES = 40  # local ones for 50 touches that are refined then, fewer for more: they are nearer to the bound anyway
SWEEPS = 2  # of moving touches: a third gains nothing that counts
FEWER = 16  # of them, where each compares sets by a criterion with kinks
Say = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Choice:
    """Touches in the order of making them, and how near they are to the best."""

    touches: Candidates
    order: Order
    joined: int = 0  # touches on offer but those that no clear way was found to, where that was asked
    efficiency: float | None = None  # against the bound on these
    manifold: float | None = None  # against the bound on all touches, as far as they were looked for


@dataclass(frozen=True, eq=False)
class Setting:
    """What a plan is to be: by which criterion, from which offer, how."""

    offered: CandidateSet
    criterion: str
    strategy: str
    rng: np.random.Generator
    draws: int = 0  # robots that the touches have to suit, besides the most likely one
    worst: bool = False

    @property
    def coordinates(self) -> Coordinates:
        """Those of the criterion."""
        return self.offered.coordinates(self.criterion)

    @cached_property
    def measure(self) -> Criterion:
        """The criterion, of the weld zone if it needs it."""
        return measured(self.criterion, self.offered)

    def quickly(self, n: int) -> Candidates:
        """Touches as the strategy has them, not refined and not ordered."""
        everything = np.ones(len(self.offered.candidates), dtype=bool)
        return self.offered.candidates.take(self._pick(n)(everything, None))

    def choose(self, n: int, say: Say) -> Choice:
        """Touches in an order; ways that cannot be kept clear are part of it."""
        if self.strategy != "optimal" or self.draws:
            say("choosing", 0.0)
            visit = visited(self.offered, self._pick(n), self.rng)
            touches = self.offered.candidates.take(visit.order.index)
            order = self._ordered(touches)
            return Choice(touches.take(order.index), order)
        say("choosing", 0.0)
        pick = Best(self.offered, n, self.criterion, searches=self._searches(n))
        visit = visited(self.offered, pick, self.rng, linked(pick))
        bound, joined = pick.bound(visit.allowed), int(visit.allowed.sum())
        touches = self.offered.candidates.take(visit.order.index)
        say("refining", 0.5)
        refinement = Refinement(self.coordinates, self.offered.feasibility)
        touches, found = self._refined(refinement, touches, lambda share: say("refining", 0.5 + 0.3 * share))
        M = self.coordinates.information(self.coordinates.rows(touches.rows(self.offered.cell)))
        efficiency, phi = self._efficiency(M, bound), self.measure.phi(M)
        if not self.measure.certified:
            return Choice(touches, found, joined, efficiency)
        say("bounding", 0.8)
        allowed = self.offered.candidates.take(visit.allowed)
        manifold = certify(refinement, allowed, pick.rows[visit.allowed], bound.support, n)
        return Choice(touches, found, joined, efficiency, phi / manifold.level)

    def _searches(self, n: int) -> int:
        return SEARCHES * 50 // max(50, n) if self.measure.formula.exact else FEWER

    def _pick(self, n: int) -> Pick:
        offered, rng = self.offered, self.rng
        if self.strategy == "even":
            return lambda allowed, before: even(offered.candidates, n, allowed)
        if self.strategy == "random":
            return lambda allowed, before: rng.choice(np.flatnonzero(allowed), n, replace=False)
        if self.draws:
            models = np.concatenate([offered.theta[None], offered.prior.robots(self.draws, rng)])
            return robust(offered, n, self.criterion, models, self.worst)
        return Best(offered, n, self.criterion)

    def _refined(
        self, refinement: Refinement, touches: Candidates, say: Callable[[float], None]
    ) -> tuple[Candidates, Order]:
        """Touches moved to where they tell more, as far as the ways between them stay clear."""
        moved = refine(refinement, touches, self.measure, sweeps=SWEEPS, progress=say)
        for around in range(1, RETURNS + 1):
            order = self._ordered(moved, touches)  # so that the old ways back are still there
            if not order.blocked:
                return moved.take(order.index), order
            ends = np.unique(
                np.concatenate([order.index[max(0, i + 1 - around) : i + 1 + around] for i in order.blocked])
            )
            moved = replaced(moved, ends, touches.take(ends))
        order = self._ordered(touches)
        return touches.take(order.index), order

    def _ordered(self, touches: Candidates, above: Candidates | None = None) -> Order:
        """A short order of touches, which are in a good one already."""
        return self.offered.visit(touches, self.rng, start=np.arange(len(touches)), above=above)[0]

    def _efficiency(self, M: Float[np.ndarray, "kept kept"], bound: ApproximateDesign) -> float | None:
        return self.measure.phi(M) / bound.level if np.isfinite(bound.level) else None
