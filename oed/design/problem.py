"""The problem of an exact design: checked, and in the terms of the search."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from oed.criteria.criteria import criterion_named
from oed.criteria.criterion import Criterion
from oed.criteria.swaps import Members
from oed.design.constraints import Rules
from oed.design.matrix import checked, checked_prior, information
from oed.design.relaxation import ApproximateDesign, approximate_design

FAR = 1e9  # where empty rows are, distant from every touch


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Rows to choose from, what is known beside them, and the rules; rows past the candidates are empty.

    A budget of time instead of a number fills as many slots as could ever fit, with empty rows where it is used up.
    """

    rows: Float[np.ndarray, "candidates parameters"]
    criterion: Criterion  # of these rows, with the zone that it needs
    fixed: Members  # touches that are in already
    before: Float[np.ndarray, "parameters parameters"]  # information of the fixed touches and the prior
    rules: Rules  # for the candidates, then as many empty rows as there are slots
    slots: int  # touches to choose beside the fixed ones
    free: Int[np.ndarray, " free"]  # rows that may be chosen

    def relaxed(self, repeats: bool) -> ApproximateDesign:
        """Best weights under the rules that weights can keep: number or budget, repeats, quotas."""
        relax = partial(approximate_design, criterion=self.criterion, prior=self.before)
        rules, real = self.rules, len(self.rows)
        if rules.cost is not None:
            share = rules.cost[:real] / rules.budget
            return relax(self.rows / np.sqrt(share)[:, None], cap=None if repeats else share)
        cap = None if repeats else 1 / self.slots
        quotas = None
        if rules.low is not None and rules.high is not None and rules.face is not None:
            limits = np.stack([rules.low, np.minimum(rules.high, self.slots)], axis=1) / self.slots
            quotas = {f: (float(low), float(high)) for f, (low, high) in enumerate(limits[:-1])}
        face = None if rules.face is None else rules.face[:real]
        return relax(self.rows, touches=self.slots, cap=cap, face=face, quotas=quotas)

    def taken(self, ids: Int[np.ndarray, " some"]) -> Float[np.ndarray, "some parameters"]:
        """Rows, zero for the empty ones."""
        X = np.zeros((len(ids), self.rows.shape[1]))
        real = ids < len(self.rows)
        X[real] = self.rows[ids[real]]
        return X


def design_problem(
    rows: np.ndarray,
    n: int | None,
    criterion: str | Criterion,
    *,
    prior: np.ndarray | None,
    zone: np.ndarray | None,
    fixed: np.ndarray | None,
    face: np.ndarray | None,
    quotas: Mapping[Any, tuple[int, int]] | None,
    positions: np.ndarray | None,
    min_distance: float,
    repeats: bool,
    cost: np.ndarray | None,
    budget: float | None,
) -> DesignProblem:
    """The problem, after every check that can be made before the search; raises ValueError."""
    rows = checked(rows)
    count, p = rows.shape
    measure = criterion_named(criterion).on(zone, p)
    fixed_members = _indices(fixed, count)
    before = checked_prior(prior, p) + information(rows[fixed_members])
    if (cost is None) != (budget is None) or (n is None and budget is None):
        raise ValueError("n: give a number of touches, or both `cost` and `budget`")
    cost = None if cost is None else _checked_cost(cost, count)
    room = np.inf if cost is None or budget is None else float(budget) - float(cost[fixed_members].sum())
    slots = _slots(
        n, len(fixed_members), count if repeats else count - len(np.unique(fixed_members)), repeats, cost, room
    )
    rank = int(np.linalg.matrix_rank(before, hermitian=True))
    if slots + rank < p:
        raise ValueError(
            f"n: {slots} touches beside what is known determine at most {slots + rank} of {p} parameters; "
            f"ask for {p - rank - slots} more, or give a prior"
        )
    rules = Rules(
        size=count + slots,
        repeats=repeats,
        distance=float(min_distance),
        budget=room,
        cost=None if cost is None else np.concatenate([cost, np.zeros(slots)]),
        position=_places(positions, min_distance, count, slots),
        **_quotas(face, quotas, fixed_members, count, slots, repeats),
    )
    free = np.ones(count + slots, bool)
    if not repeats:
        free[fixed_members] = False
    if rules.position is not None and len(fixed_members):
        free &= ~rules.near(fixed_members).any(axis=0)
    if cost is None:
        free[count:] = False
    return DesignProblem(rows, measure, fixed_members, before, rules, slots, np.flatnonzero(free))


def _indices(fixed: np.ndarray | None, count: int) -> Members:
    """Touches that are in already."""
    members = np.zeros(0, int) if fixed is None else np.asarray(fixed)
    if members.ndim != 1 or (len(members) and not np.issubdtype(members.dtype, np.integer)):
        raise ValueError("fixed: expected a list of indices of rows")
    if len(members) and (members.min() < 0 or members.max() >= count):
        raise ValueError(
            f"fixed: index {members.max() if members.max() >= count else members.min()} is outside 0 ... {count - 1}"
        )
    return members.astype(int)


def _checked_cost(cost: np.ndarray, count: int) -> Float[np.ndarray, " candidates"]:
    """Costs as positive numbers, one a candidate."""
    cost = np.asarray(cost, dtype=float)
    if cost.shape != (count,) or not (np.isfinite(cost).all() and (cost > 0).all()):
        raise ValueError(f"cost: expected one positive number for each of the {count} candidates")
    return cost


def _slots(n: int | None, fixed: int, free: int, repeats: bool, cost: np.ndarray | None, room: float) -> int:
    """How many touches there are to choose."""
    if n is not None and n != int(n):
        raise ValueError(f"n: {n:g}, expected a whole number of touches")
    slots = free if n is None else int(n) - fixed
    if n is not None and slots < 1:
        raise ValueError(f"n: {n} touches of which {fixed} are fixed leave none to choose; ask for more")
    if not repeats and slots > free:
        raise ValueError(
            f"n: {slots} touches to choose and only {free} candidates left; add candidates, or allow repeats"
        )
    if cost is None:
        return slots
    cheap = int(room / cost.min()) if repeats else int((np.cumsum(np.sort(cost)) <= room * (1 + 1e-12)).sum())
    if cheap < 1:
        raise ValueError(f"budget: {room:.6g} is left, and the cheapest touch costs {cost.min():.6g}; raise the budget")
    return cheap if n is None else min(slots, cheap)


def _places(
    positions: np.ndarray | None, distance: float, count: int, slots: int
) -> Float[np.ndarray, "candidates axes"] | None:
    """Positions of the candidates, then of the empty rows; None where no distance is asked for."""
    if distance <= 0:
        return None
    where = np.asarray(positions if positions is not None else [], dtype=float)
    if where.ndim != 2 or len(where) != count or not np.isfinite(where).all():
        raise ValueError(f"min_distance: it needs `positions`, one finite row for each of the {count} candidates")
    empty = np.zeros((slots, where.shape[1]))
    empty[:, 0] = FAR * np.arange(1, slots + 1)
    return np.concatenate([where, empty])


def _quotas(
    face: np.ndarray | None,
    quotas: Mapping[Any, tuple[int, int]] | None,
    fixed: Members,
    count: int,
    slots: int,
    repeats: bool,
) -> dict[str, np.ndarray]:
    """Face of each row, and how many touches each face must and may still get; the last face is that of empty rows."""
    if not quotas:
        return {}
    if face is None or np.shape(face) != (count,):
        raise ValueError(f"quotas: they need `face`, the face of each of the {count} candidates")
    names, group = np.unique(np.asarray(face), return_inverse=True)
    missing = [name for name, (low, _) in quotas.items() if low > 0 and name not in names.tolist()]
    if missing:
        raise ValueError(f"quota of face {missing[0]}: no candidate lies on it")
    limits = np.array([quotas.get(name, (0, slots + len(fixed))) for name in names.tolist()], dtype=int).reshape(-1, 2)
    present = np.bincount(group[fixed], minlength=len(names))
    low, high = np.maximum(limits[:, 0] - present, 0), limits[:, 1] - present
    has = np.full(len(names), count) if repeats else np.bincount(group, minlength=len(names)) - present
    for name, least, most, room in zip(names, low, high, has, strict=True):
        if most < least:
            raise ValueError(f"quota of face {name}: it takes {most} more touches and needs {least}; loosen it")
        if room < least:
            raise ValueError(f"quota of face {name}: it has {room} candidates and needs {least}; add candidates")
    high = np.minimum(high, has)
    if low.sum() > slots or np.minimum(high, slots).sum() < slots:
        raise ValueError(
            f"quotas: the faces need {low.sum()} touches and take {high.sum()}, {slots} are to be chosen; loosen one"
        )
    return {
        "face": np.concatenate([group, np.full(slots, len(names))]),
        "low": np.append(low, 0),
        "high": np.append(np.minimum(high, slots), slots),
    }
