"""Plan touches: the set that tells the most about the robot where it matters, and what to expect of it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from identify.model.calibration import Calibration
from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.touch import Plan
from oed.candidates import Candidates, candidates
from oed.information import knowledge_after, nominal_knowledge, touch_sigma
from oed.zone import Promise, promise, zone_poses

Strategy = Literal["optimal", "even", "random"]
Progress = Callable[[str, float], None]  # what is being done, and how much of the whole is done (0 ... 1)


@dataclass(frozen=True, eq=False)
class PlanResult:
    """A plan, and what it promises."""

    plan: Plan
    strategy: str
    criterion: str
    indices: dict[str, float]  # every criterion of the table
    efficiency: float | None  # against the bound on what `efficiency_covers`; None where there is no bound
    efficiency_covers: str
    promise: Promise
    minutes: float
    unseen: tuple[str, ...]  # sentences: what this jig cannot see

    def __len__(self) -> int:
        return len(self.plan)


def plan(
    cell: Cell,
    n: int = 50,
    criterion: str = "D",
    strategy: Strategy = "optimal",
    rng: np.random.Generator | None = None,
    *,
    after: Calibration | None = None,
    progress: Progress | None = None,
) -> PlanResult:
    """Choose n touches of the jig; raises InputError, in one sentence, where no plan can be made."""
    rng = np.random.default_rng(0) if rng is None else rng
    say = progress or (lambda what, share: None)
    known = nominal_knowledge(cell) if after is None else knowledge_after(cell, after)
    say("reach", 0.0)
    if cell.jig is None:
        raise InputError("the cell has no jig to touch; name one in cell.yaml (jig: library:step-block)")
    found = candidates(cell, rng)
    say("choose", 0.6)
    F = known.rows(found.q, found.normal, touch_sigma(cell, found.names()))
    chosen = _greedy(F, known.precision, n) if strategy == "optimal" else rng.choice(len(F), n, replace=False)
    picked = _plan_of(found.take(chosen))
    tip = known.tip_rows(zone_poses(cell, known.theta))
    C = known.covariance(F[chosen])
    s = np.linalg.svd(F[chosen], compute_uv=False)
    say("done", 1.0)
    return PlanResult(
        plan=picked, strategy=strategy, criterion=criterion,
        indices={"O1": float(np.exp(np.log(s).mean()) / np.sqrt(n))},
        efficiency=None, efficiency_covers="candidates", promise=promise(tip, C),
        minutes=n * 8.0 / 60, unseen=(),
    )  # fmt: skip


def summary(result: PlanResult) -> dict[str, Any]:
    """What `touchcal plan --json` says."""
    return {
        "touches": len(result.plan),
        "criterion": result.criterion,
        "strategy": result.strategy,
        "indices": dict(result.indices),
        "efficiency": result.efficiency,
        "efficiency_covers": result.efficiency_covers,
        "promise": {"rms_mm": result.promise.rms_mm, "p95_mm": result.promise.p95_mm},
        "minutes": result.minutes,
        "unseen": list(result.unseen),
    }


def _plan_of(found: Candidates) -> Plan:
    """Touches as they stand in plan.csv."""
    ids = tuple(str(i + 1) for i in range(len(found)))
    return Plan(ids, found.names(), found.point, found.normal, found.q, found.approach)


def _greedy(F: Float[np.ndarray, "rows kept"], M: Float[np.ndarray, "kept kept"], n: int) -> Int[np.ndarray, " n"]:
    """Add the touch that adds most to log det, n times."""
    C = np.linalg.inv(M)
    chosen: list[int] = []
    for _ in range(n):
        gain = np.einsum("ij,ij->i", F @ C, F)
        gain[chosen] = -1
        i = int(np.argmax(gain))
        chosen.append(i)
        x = C @ F[i]
        C -= np.outer(x, x) / (1 + F[i] @ x)
    return np.array(chosen)
