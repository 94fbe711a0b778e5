"""Plan touches: the set that tells the most about the robot where it matters, and what to expect of it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from identify.model.cell import Cell
from identify.model.files import InputError, nearest
from identify.model.io.calibration_file import Calibration
from identify.model.touch import Plan
from identify.uncertainty.promise import Promise
from identify.uncertainty.weak_directions import limiting, unseen
from oed.criteria.criteria import CRITERIA, score
from oed.planning.candidate_set import CandidateSet, make_candidate_set, plan_of
from oed.planning.curve import curve, smallest
from oed.planning.strategies import STRATEGIES, Choice, Setting
from probe.motion.roadmap import with_via
from probe.motion.tour import Order, minutes

CRITERION = "V"
COUNT = 20_000  # touches on offer: more are worth a percent each time that their number doubles
Progress = Callable[[str, float], None]  # what is being done, and how much of the whole is done (0 ... 1)


@dataclass(frozen=True, eq=False)
class PlanResult:
    """A plan, and what it promises."""

    plan: Plan
    """The touches in the order in which they are made."""
    strategy: str
    """optimal, even or random."""
    criterion: str
    """Its name."""
    indices: dict[str, float]
    """Every criterion of the table, of these touches alone."""
    efficiency: float | None
    """Against the bound on what `efficiency_covers`; None where there is no bound."""
    efficiency_covers: str
    """Candidates: the touches on offer that clear ways join."""
    joined: int
    """Touches that clear ways join."""
    count: int
    """Touches on offer, polished ones with them."""
    manifold: float | None
    """Efficiency against all touches that can be made, as far as `manifold_covers` says."""
    manifold_covers: str | None
    """The touches that were looked at, in words; None where there is no such bound."""
    promise: Promise
    """Tip error to expect in the zone [mm]."""
    minutes: float
    """That the run takes."""
    missing: tuple[float, ...]
    """The share of the robots drawn from what is known that miss each touch."""
    unseen: tuple[str, ...]
    """Sentences: what these touches cannot see, and what to add."""
    notes: tuple[str, ...]
    """Sentences: faces not reached, ways not clear, what limits the accuracy."""
    choice: Choice
    """The touches among the candidates of `setting`."""
    setting: Setting
    """How they were chosen."""

    @cached_property
    def curve(self) -> tuple[tuple[int, float], ...]:
        """Numbers of touches, and the 95 % tip error in the zone to expect [mm]; computed when it is asked for."""
        setting, touches = self.setting, self.choice.touches
        with threadpool_limits(1):
            return curve(setting.candidate_set, touches, lambda n: setting.resized(touches, n))

    def __len__(self) -> int:
        return len(self.plan)

    def __repr__(self) -> str:
        near = "no bound" if self.efficiency is None else f"at least {100 * self.efficiency:.1f} % of the best on offer"
        near = "better than any choice on offer" if (self.efficiency or 0) > 1 else near
        if self.manifold is not None:
            near += f", {100 * self.manifold:.1f} % of the best of all as far as they were priced"
        return (
            f"<PlanResult: {len(self)} touches, {self.strategy} {self.criterion}, {self.minutes:.0f} minutes, {near}; "
            f"promise {self.promise.rms_mm:.3f} mm RMS, {self.promise.p95_mm:.3f} mm at 95 % of the weld zone; "
            f"{len(self.unseen)} unseen, {len(self.notes)} notes>"
        )


def plan(
    cell: Cell,
    n: int | None = None,
    criterion: str = CRITERION,
    strategy: str = "optimal",
    rng: np.random.Generator | None = None,
    *,
    target: float | None = None,
    after: Calibration | None = None,
    lifting: bool = True,
    count: int = COUNT,
    seconds: float | None = None,
    progress: Progress | None = None,
) -> PlanResult:
    """Choose touches of the jig: `n` of them (50), or as few as bring the tip error in the zone below `target`.

    `target` is the 95 % error [mm]. To what an earlier calibration knows (`after`), new touches are added. They are
    chosen for robots drawn from what is known, each of which misses other touches, and so is what they promise.
    Without `lifting` all ways between touches are straight. `count` touches are on offer. The same `rng` gives the same
    plan, except with `seconds`: then the search for better touches and a better bound takes so long. Raises InputError
    where no plan can be made.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    say = progress or (lambda what, share: None)
    _check(n, target, criterion, strategy, seconds)
    with threadpool_limits(1):  # threads cost more than they save on small matrices, and their sums differ
        say("finding touches that can be made", 0.0)
        candidate_set = make_candidate_set(
            cell, rng, after=after, count=count, structured=strategy == "optimal", lifting=lifting
        )
        setting = Setting(candidate_set, criterion, strategy, rng, seconds)
        if target is not None:
            say("looking for the number of touches", 0.3)
            n = smallest(candidate_set, target, setting.quickly)
        n = 50 if n is None else n
        if n > len(candidate_set.candidates):
            raise InputError(
                f"{n} touches are asked for, and only {len(candidate_set.candidates)} were found that can be made"
            )
        choice = setting.choose(n, lambda what, share: say(what, 0.4 + 0.6 * share))
        while (
            target is not None
            and candidate_set.promise(choice.touches).p95_mm > target
            and n < len(candidate_set.candidates)
        ):
            n = min(
                max(n + 1, round(1.05 * n)), len(candidate_set.candidates)
            )  # what clear ways join is a little less good
            choice = setting.choose(n, lambda what, share: say(what, 0.4 + 0.6 * share))
        say("done", 1.0)
        return _result(setting, choice)


def summary(result: PlanResult) -> dict[str, Any]:
    """What `touchcal plan --json` says."""
    return {
        "touches": len(result.plan),
        "criterion": result.criterion,
        "strategy": result.strategy,
        "indices": dict(result.indices),
        "efficiency": result.efficiency,
        "efficiency_covers": result.efficiency_covers,
        "candidates": {"offered": result.count, "joined": result.joined},
        "manifold": result.manifold,
        "manifold_covers": result.manifold_covers,
        "promise": {"rms_mm": result.promise.rms_mm, "p95_mm": result.promise.p95_mm},
        "curve": [{"touches": m, "p95_mm": error} for m, error in result.curve],
        "minutes": result.minutes,
        "missing": list(result.missing),
        "unseen": list(result.unseen),
        "notes": list(result.notes),
    }


def _check(n: int | None, target: float | None, criterion: str, strategy: str, seconds: float | None) -> None:
    """Raise InputError where the words are not known or say two things at once."""
    for word, value, choices in (("criterion", criterion, CRITERIA), ("strategy", strategy, STRATEGIES)):
        if value not in choices:
            raise InputError(
                f"{word} '{value}' is not known{nearest(value, choices)}; choose one of {', '.join(choices)}"
            )
    if n is not None and n < 1:
        raise InputError(f"{n} touches are asked for, expected a number above 0")
    if n is not None and target is not None:
        raise InputError("a number of touches and a target are given; give one, the other follows from it")
    if target is not None and not target > 0:
        raise InputError(f"target {target:g} mm: write the 95 % tip error in the zone that is wanted, above 0")
    if seconds is not None and not 0 < seconds < np.inf:
        raise InputError(f"seconds {seconds:g}: write how long the plan may search, above 0")


def _result(setting: Setting, choice: Choice) -> PlanResult:
    """What a chosen set promises."""
    candidate_set, touches = setting.candidate_set, choice.touches
    plan, basis = with_via(plan_of(touches), choice.order.via), candidate_set.identifiable.basis
    rows, promised = candidate_set.rows_of(touches), candidate_set.promise(touches)
    return PlanResult(
        plan=plan,
        strategy=setting.strategy,
        criterion=setting.criterion,
        indices=indices(candidate_set, rows),
        efficiency=choice.efficiency,
        efficiency_covers="candidates",
        joined=choice.joined,
        count=choice.count or len(candidate_set.candidates),
        manifold=choice.manifold,
        manifold_covers=choice.certificate.covers if choice.manifold is not None and choice.certificate else None,
        promise=promised,
        minutes=minutes(candidate_set.cell, plan, candidate_set.deviations(touches)),
        missing=tuple(candidate_set.searches(touches).missing.tolist()),
        unseen=unseen(
            candidate_set.identifiable,
            candidate_set.rows_of(candidate_set.candidates) @ basis,
            rows @ basis,
            candidate_set.zone,
        ),
        notes=(
            *candidate_set.candidates.notes,
            *promised.sentences(),
            *candidate_set.searches(touches).sentences(),
            *blocked_ways(plan, choice.order),
            limiting(candidate_set.prior.updated(rows), candidate_set.zone),
        ),
        choice=choice,
        setting=setting,
    )


def indices(candidate_set: CandidateSet, rows: Float[np.ndarray, "touches unknowns"]) -> dict[str, float]:
    """Every criterion of the touches: of the weld zone by all unknowns and priors, others by the touches alone.

    A criterion that so few touches leave without a value is left out.
    """
    values = {}
    for name, criterion in CRITERIA.items():
        coordinates = candidate_set.coordinates(criterion)
        F = rows @ coordinates.basis
        M = coordinates.information(F) if criterion.needs_zone else F.T @ F
        values[name] = float(score(criterion, M, len(rows), coordinates.of_tip(candidate_set.tip)))
    return {name: value for name, value in values.items() if np.isfinite(value)}


def blocked_ways(plan: Plan, order: Order) -> tuple[str, ...]:
    """A sentence for each way between touches that is not clear."""
    return tuple(
        f"the straight way from touch {plan.ids[i]} to touch {plan.ids[i + 1]} is not clear of the jig; "
        "drive around it by hand, or plan with another number of touches"
        for i in order.blocked
    )
