"""The strategies of planning: optimal, even and random, each from an offer to touches in the order of making them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from identify.uncertainty.information import drawn, touch_sigma
from oed.candidates.candidates import Candidates
from oed.candidates.even import even
from oed.criteria.aim import Aim, mean_square
from oed.criteria.criteria import CRITERIA
from oed.design.relaxation import ApproximateDesign, phi
from oed.planning.candidate_set import Offer
from oed.planning.visitable import Best, Pick, linked, robust, visited
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

    offered: Offer
    criterion: str
    strategy: str
    rng: np.random.Generator
    draws: int = 0  # robots that the touches have to suit, besides the most likely one
    worst: bool = False

    @cached_property
    def aim(self) -> Aim:
        """The criterion itself where it is smooth, else the smooth one that is nearest to it."""
        if CRITERIA[self.criterion].swaps == "determinant":
            return Aim()
        zone = CRITERIA[self.criterion].needs_zone
        return Aim(mean_square(self.offered.tip) if zone else np.eye(len(self.offered.known.names)))

    @property
    def smooth(self) -> bool:
        """Whether `aim` is the criterion itself."""
        return CRITERIA[self.criterion].swaps != "screened"

    def quickly(self, n: int) -> Candidates:
        """Touches as the strategy has them, not refined and not ordered."""
        everything = np.ones(len(self.offered.found), dtype=bool)
        return self.offered.found.take(self._pick(n)(everything, None))

    def choose(self, n: int, say: Say) -> Choice:
        """Touches in an order; ways that cannot be kept clear are part of it."""
        if self.strategy != "optimal" or self.draws:
            say("choosing", 0.0)
            visit = visited(self.offered, self._pick(n), self.rng)
            touches = self.offered.found.take(visit.order.index)
            order = self._ordered(touches)
            return Choice(touches.take(order.index), order)
        say("choosing", 0.0)
        pick = Best(self.offered, n, self.criterion, searches=self._searches(n))
        visit = visited(self.offered, pick, self.rng, linked(pick))
        bound, joined = pick.bound(visit.allowed), int(visit.allowed.sum())
        touches = self.offered.found.take(visit.order.index)
        say("refining", 0.5)
        refinement = Refinement(self.offered.known, self.offered.feasibility)
        touches, found = self._refined(refinement, touches, lambda share: say("refining", 0.5 + 0.3 * share))
        M = self._information(self._rows(touches))
        if not self.smooth:
            return Choice(touches, found, joined, self._efficiency(M, bound))
        say("bounding", 0.8)
        manifold = certify(self.offered, refinement, self.aim, bound.information, n, visit.allowed)
        return Choice(touches, found, joined, self._efficiency(M, bound), manifold.efficiency(self.aim, M))

    def _searches(self, n: int) -> int:
        return SEARCHES * 50 // max(50, n) if self.smooth else FEWER

    def _pick(self, n: int) -> Pick:
        offered, rng = self.offered, self.rng
        if self.strategy == "even":
            return lambda allowed, before: even(offered.found, n, allowed)
        if self.strategy == "random":
            return lambda allowed, before: rng.choice(np.flatnonzero(allowed), n, replace=False)
        if self.draws:
            models = np.concatenate([offered.known.theta[None], drawn(offered.known, self.draws, rng)])
            return robust(offered, n, self.criterion, models, self.worst)
        return Best(offered, n, self.criterion)

    def _refined(
        self, refinement: Refinement, touches: Candidates, say: Callable[[float], None]
    ) -> tuple[Candidates, Order]:
        """Touches moved to where they tell more, as far as the ways between them stay clear."""
        moved = refine(refinement, touches, self.aim, self._value, sweeps=SWEEPS, progress=say)
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

    def _value(self, rows: Float[np.ndarray, "touches kept"]) -> float:
        """Of the criterion, as a logarithm."""
        M = self._information(rows)
        return self.aim.value(M) if self.smooth else float(np.log(max(self._phi(M), 1e-300)))

    def _phi(self, M: Float[np.ndarray, "kept kept"]) -> float:
        zone = self.offered.tip if CRITERIA[self.criterion].needs_zone else None
        return phi(CRITERIA[self.criterion], M, zone)

    def _rows(self, touches: Candidates) -> Float[np.ndarray, "touches kept"]:
        sigma = touch_sigma(self.offered.known.cell, touches.names())
        return self.offered.known.rows(touches.q, touches.normal, sigma, approach=touches.approach)

    def _information(self, rows: Float[np.ndarray, "touches kept"]) -> Float[np.ndarray, "kept kept"]:
        return self.offered.known.precision + rows.T @ rows

    def _efficiency(self, M: Float[np.ndarray, "kept kept"], bound: ApproximateDesign) -> float | None:
        return float(self._phi(M) / bound.level) if np.isfinite(bound.level) else None
