"""Plan measurements of several kinds together: those that tell the most where it matters, for a budget of minutes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Int

from identify.model.cell import Cell
from identify.model.files import InputError, nearest
from identify.model.io.calibration_file import Calibration
from identify.model.io.kinds_plan import PlanPart
from identify.model.measurement import MEASUREMENTS
from identify.uncertainty.promise import Promise
from oed.criteria.criteria import CRITERIA
from oed.design.budget import BudgetDesign
from oed.planning.kinds_problem import COUNT, KindsProblem, Limit, kinds_problem
from probe.motion.roadmap import with_via
from probe.motion.tour import Order

TRIES = 5  # of choosing again where the chosen cannot be visited
NEAR = 0.7  # of what is promised: a limit that more measurements do not pass
SHARES = (0.25, 0.5, 1.0, 2.0, 4.0)  # of the budget, for the curve
Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class KindsPlan:
    """Measurements of several kinds, and what they promise."""

    parts: tuple[PlanPart, ...]
    criterion: str
    minutes: float  # of measuring; mounting devices is not in it
    budget: float
    efficiency: float | None  # against the bound on the candidates; None where there is no bound
    candidates: dict[str, int]  # by kind
    promise: Promise
    curve: tuple[tuple[float, float], ...]  # minutes, and the 95 % tip error in the zone to expect [mm]
    alone: dict[str, Promise]  # what each kind alone promises for the same minutes
    limit: Limit
    notes: tuple[str, ...]

    @property
    def counts(self) -> dict[str, int]:
        """Measurements of each kind."""
        return {part.kind: len(part.plan) for part in self.parts}


def plan_kinds(
    cell: Cell,
    kinds: Sequence[str],
    budget: float,
    criterion: str = "V",
    rng: np.random.Generator | None = None,
    *,
    after: Calibration | None = None,
    count: int = COUNT,
    progress: Progress | None = None,
) -> KindsPlan:
    """Choose measurements of some kinds whose minutes fit a budget: those that together tell the most.

    Every kind takes the minutes of its device (`Cell.device`). Candidates of all kinds are weighed in one design, whose
    bound covers all of them. Raises InputError where no plan can be made.
    """
    rng, say = np.random.default_rng(0) if rng is None else rng, progress or (lambda what, share: None)
    _check(kinds, budget, criterion)
    say("finding measurements that can be made", 0.0)
    problem = kinds_problem(cell, kinds, rng, after=after, count=count)
    say("choosing", 0.3)
    return _planned(problem, budget, criterion, rng, say)


def _check(kinds: Sequence[str], budget: float, criterion: str) -> None:
    """Raise InputError where words are not known."""
    for kind in kinds:
        if kind not in MEASUREMENTS:
            hint = nearest(kind, MEASUREMENTS)
            raise InputError(f"kind '{kind}' is not known{hint}; choose of {', '.join(MEASUREMENTS)}")
    if not kinds:
        raise InputError(f"no kind is named; choose of {', '.join(MEASUREMENTS)}")
    if not 0 < budget < np.inf:
        raise InputError(f"a budget of {budget:g} minutes: write how long measuring may take, above 0")
    if criterion not in CRITERIA:
        hint = nearest(criterion, CRITERIA)
        raise InputError(f"criterion '{criterion}' is not known{hint}; choose one of {', '.join(CRITERIA)}")


def _planned(
    problem: KindsProblem, budget: float, criterion: str, rng: np.random.Generator, say: Progress
) -> KindsPlan:
    """The plan: the best measurements that the robot can visit one after the other, kind by kind."""
    allowed = [np.ones(len(offer), dtype=bool) for offer in problem.offers]
    best: tuple[int, BudgetDesign, list[np.ndarray], list[Order]] | None = None
    for attempt in range(TRIES):
        say("choosing", 0.3 + 0.5 * attempt / TRIES)
        design, members = problem.design(budget, criterion, rng, allowed)
        orders, blocked = [], 0
        for offer, index, some in zip(problem.offers, members, allowed, strict=True):
            order, clear = problem.visit(offer, index, rng)
            orders.append(order)
            blocked += len(order.blocked)
            some &= ~problem.astray(offer, index, order, clear)
        if best is None or blocked < best[0]:
            best = blocked, design, members, orders
        if not blocked:
            break
    assert best is not None
    say("done", 1.0)
    return _result(problem, budget, criterion, best[1], best[2], best[3])


def _result(
    problem: KindsProblem,
    budget: float,
    criterion: str,
    design: BudgetDesign,
    members: list[Int[np.ndarray, " some"]],
    orders: list[Order],
) -> KindsPlan:
    parts, notes = [], list(problem.notes)
    begin = 0
    for offer, index, order in zip(problem.offers, members, orders, strict=True):
        if not len(index):
            continue
        index = index[order.index]
        ids = tuple(str(begin + i + 1) for i in range(len(index)))
        plan = replace(with_via(offer.postures.take(index), order.via), ids=ids)
        table = None if offer.table is None else replace(offer.table.take(index), ids=ids)
        parts.append(PlanPart(offer.kind, plan, table))
        notes += [
            f"the way from {offer.kind} {ids[i]} to {ids[i + 1]} is not clear; drive around it by hand"
            for i in order.blocked
        ]
        if offer.touches is not None:
            notes += [
                *offer.touches.candidates.notes,
                *offer.touches.searches(offer.touches.candidates.take(index)).sentences(),
            ]
        begin += len(index)
    alone, promised, limit = {}, problem.promised(members), problem.limit()
    if limit.rms_mm > NEAR * promised.rms_mm:
        notes.append(
            f"however many of these are made, {limit.rms_mm:.3f} mm RMS are left in the zone, mostly by "
            f"{', '.join(limit.names)}, which they do not tell; another kind of measurement, further anchors or faces, "
            "or smaller tolerances would"
        )
    if len(problem.offers) > 1:
        for offer in problem.offers:
            single = problem.only(offer.kind)
            alone[offer.kind] = single.promised(single.design(budget, criterion, excursions=0)[1])
    return KindsPlan(
        parts=tuple(parts),
        criterion=criterion,
        minutes=design.cost,
        budget=budget,
        efficiency=design.efficiency if np.isfinite(design.efficiency) else None,
        candidates={offer.kind: len(offer) for offer in problem.offers},
        promise=promised,
        curve=tuple((share * design.cost, problem.promised(members, share).p95_mm) for share in SHARES),
        alone=alone,
        limit=limit,
        notes=tuple(notes),
    )


def summary(result: KindsPlan) -> dict[str, Any]:
    """What `touchcal plan --kinds ... --json` says."""
    return {
        "measurements": result.counts,
        "criterion": result.criterion,
        "minutes": result.minutes,
        "budget_min": result.budget,
        "efficiency": result.efficiency,
        "efficiency_covers": "candidates",
        "candidates": result.candidates,
        "promise": {"rms_mm": result.promise.rms_mm, "p95_mm": result.promise.p95_mm},
        "alone": {kind: {"rms_mm": p.rms_mm, "p95_mm": p.p95_mm} for kind, p in result.alone.items()},
        "curve": [{"minutes": minutes, "p95_mm": error} for minutes, error in result.curve],
        "limit_rms_mm": result.limit.rms_mm,
        "notes": list(result.notes),
    }
