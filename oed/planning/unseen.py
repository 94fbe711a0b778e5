"""Plan touches to verify with: those that stand for all that can be made, and away from those of the fit."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.calibration_file import Calibration
from identify.model.touch import Plan
from oed.candidates.candidates import COUNT, Candidates
from oed.planning.candidate_set import make_candidate_set, plan_of
from oed.planning.plan import blocked_ways
from oed.planning.visitable import visited
from probe.motion.roadmap import with_via
from probe.motion.tour import minutes

N = 20  # touches, if nobody says how many
SAMPLE = 2000  # touches that stand for all
NEAREST = 0.25  # share of the touches, those nearest to a touch of the fit, that are not chosen


@dataclass(frozen=True, eq=False)
class UnseenPlan:
    """A plan of touches to verify with."""

    plan: Plan
    apart: float | None  # [deg] or [mm]: each differs that much from each touch of the fit in some joint
    minutes: float
    notes: tuple[str, ...]


def plan_unseen(
    cell: Cell,
    fit: Float[np.ndarray, "touches joints"],
    n: int | None = None,
    rng: np.random.Generator | None = None,
    *,
    after: Calibration | None = None,
    count: int = COUNT,
) -> UnseenPlan:
    """Choose `n` touches (20) that differ from those of the `fit`, whose joint values are given [rad] or [mm].

    They stand for all touches that can be made, each face counting alike: the greedy solution of the facility location
    problem (Nemhauser, Wolsey, Fisher 1978), distances being those of contact points and joints in units of their
    spread. The touches nearest to one that was seen are not chosen. `count` touches are on offer. Raises InputError if
    too few touches can be made.
    """
    rng, n = np.random.default_rng(0) if rng is None else rng, N if n is None else n
    candidate_set = make_candidate_set(cell, rng, after=after, count=count, structured=False)
    if not 0 < n <= len(candidate_set.candidates) * (1 - NEAREST):
        raise InputError(
            f"{n} touches are asked for, and {len(candidate_set.candidates)} were found that can be made; ask for fewer"
        )
    features, away = _features(candidate_set.candidates, fit)
    weight = 1 / candidate_set.candidates.number[candidate_set.candidates.face]
    sample = rng.choice(len(features), min(SAMPLE, len(features)), replace=False, p=weight / weight.sum())
    visit = visited(candidate_set, lambda allowed, before: _representative(features, away & allowed, sample, n), rng)
    touches = candidate_set.candidates.take(visit.order.index)
    order, _ = candidate_set.visit(touches, rng, start=np.arange(len(touches)))
    touches = touches.take(order.index)
    plan = with_via(plan_of(touches), order.via)
    return UnseenPlan(
        plan=plan,
        apart=_apart(cell, touches.q, fit),
        minutes=minutes(candidate_set.cell, plan, candidate_set.deviations(touches)),
        notes=(
            *candidate_set.candidates.notes,
            *candidate_set.searches(touches).sentences(),
            *blocked_ways(plan, order),
        ),
    )


def _features(
    candidates: Candidates, fit: Float[np.ndarray, "touches joints"]
) -> tuple[Float[np.ndarray, "touches features"], Bool[np.ndarray, " touches"]]:
    """Contact points and joints in units of their spread, and which touches are not among the nearest to one seen."""
    scale = np.maximum(candidates.q.std(axis=0), 1e-9)
    features = np.hstack([candidates.point / np.maximum(candidates.point.std(axis=0), 1e-9), candidates.q / scale])
    if not len(fit):
        return features, np.ones(len(features), dtype=bool)
    from scipy.spatial import KDTree

    distance = KDTree(fit / scale).query(candidates.q / scale)[0]
    return features, np.asarray(distance > np.quantile(distance, NEAREST))


def _representative(
    features: Float[np.ndarray, "touches features"],
    allowed: Bool[np.ndarray, " touches"],
    sample: Int[np.ndarray, " sample"],
    n: int,
) -> Int[np.ndarray, " n"]:
    """The touches, one after the other, that bring all of a sample nearest to a chosen one."""
    from scipy.spatial.distance import cdist

    eligible = np.concatenate([sample[allowed[sample]], np.setdiff1d(np.flatnonzero(allowed), sample)])[:SAMPLE]
    distance = cdist(features[sample], features[eligible])
    nearest, members = np.full(len(sample), np.inf), list[int]()
    for _ in range(n):
        total = np.minimum(distance, nearest[:, None]).sum(axis=0)
        total[members] = np.inf
        members.append(int(total.argmin()))
        nearest = np.minimum(nearest, distance[:, members[-1]])
    return eligible[members]


def _apart(cell: Cell, q: Float[np.ndarray, "touches joints"], fit: Float[np.ndarray, "seen joints"]) -> float | None:
    if not len(fit):
        return None
    return float((np.abs(q[:, None] - fit) / cell.robot.joint_unit()).max(axis=2).min())
