"""What changed while touches were made: a wire cut between two of them, a jig or base that drifts.

Every suspicion is a column that the model does not have. It is held against the residuals with all that parameters and
priors explain taken out of it (a score test, Rao 1948), so a suspicion that the parameters could carry is no evidence.
What the evidence shows becomes an unknown of the problem: touches before and after it serve together.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import fdtrc, ndtri

from identify.estimation.problem import Problem
from identify.estimation.robust import CERTAIN, Estimate, cost, estimate
from identify.model.io.calibration_file import Finding
from identify.model.measurement import Measurements
from identify.model.touch import Touches
from identify.uncertainty.promise import INTERVAL
from identify.uncertainty.unknowns import Shared, Unknowns, drift, stickout

SURE = 1e-5  # chance that touches without fault are accused of one
MANY = 0.05  # of the touches left out: then the fault may be among them
LIMIT = 4  # changes in time that are told apart


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals at a solution in units of their scatter, an orthonormal basis of what the model explains, and freedom.

    The rows of the priors stand below those of the measurements: without them a few measurements would have residuals
    of zero, and any suspicion would be certain.
    """

    r: Float[np.ndarray, " rows_and_priors"]
    Q: Float[np.ndarray, "rows_and_priors columns"]
    unit: Float[np.ndarray, " rows"]  # one over the scatter of a row [1/mm]
    stated: float  # squares that the stated sigma adds to those of r
    freedom: float  # degrees of freedom of all these squares

    def without(self, columns: Float[np.ndarray, "rows more"]) -> "Residuals":
        """The same with these columns in the model."""
        (new,) = self._new(columns[None])
        freedom = self.freedom - new.shape[1]
        return replace(self, r=self.r - new @ (new.T @ self.r), Q=np.hstack([self.Q, new]), freedom=freedom)

    @property
    def total(self) -> float:
        """Sum of squares, the stated sigma's among them."""
        return float(self.r @ self.r) + self.stated

    def explained_by_each(self, columns: Float[np.ndarray, "groups rows more"]) -> list[tuple[float, int]]:
        """Sum of squares that each group of columns explains beyond the model, and how many of them are new."""
        return [(float(((new.T @ self.r) ** 2).sum()), new.shape[1]) for new in self._new(columns)]

    def deviations(self, gain: float, count: int = 1) -> float:
        """Standard deviations of a normal number that are as improbable as this gain of so many columns (F test)."""
        freedom = max(self.freedom - count, 1.0)
        ratio = gain / count / (max(self.total - gain, 1e-9) / freedom)
        chance = float(fdtrc(count, freedom, ratio)) / 2
        return float(-ndtri(chance)) if chance > 1e-300 else float(np.sqrt(max(gain, 37.0**2)))

    def _padded(self, columns: Float[np.ndarray, "*groups rows more"]) -> Float[np.ndarray, "*groups more_rows more"]:
        """Columns in units of the scatter, 0 in the rows of the priors."""
        out = np.zeros((*columns.shape[:-2], len(self.r), columns.shape[-1]))
        out[..., : len(self.unit), :] = columns * self.unit[:, None]
        return out

    def _new(self, columns: Float[np.ndarray, "groups rows more"]) -> list[Float[np.ndarray, "rows_and_priors new"]]:
        """An orthonormal basis of what each group of columns adds to the model."""
        B = self._padded(columns)
        size = np.sqrt((B * B).sum(axis=1, keepdims=True))
        new, R = np.linalg.qr((B - self.Q @ (self.Q.T @ B)) / np.where(size > 0, size, 1.0))
        independent = np.abs(np.diagonal(R, axis1=1, axis2=2)) > 1e-6
        return [basis[:, some] for basis, some in zip(new, independent, strict=True)]

    def fit(self, columns: Float[np.ndarray, "rows more"]) -> Float[np.ndarray, " more"]:
        """How much of each of some columns together the residuals hold."""
        B = self._padded(columns)
        return np.asarray(np.linalg.lstsq(B - self.Q @ (self.Q.T @ B), self.r, rcond=1e-6)[0])

    def amount(self, column: Float[np.ndarray, " rows"]) -> tuple[float, float]:
        """How much of a column the residuals hold, and how many standard deviations that is from nothing."""
        b = self._padded(column[:, None])[:, 0]
        rest = b - self.Q @ (self.Q.T @ b)
        size = float(rest @ rest)
        if size < 1e-9 * max(float(b @ b), 1e-300):
            return 0.0, 0.0
        score = float(rest @ self.r)
        return score / size, float(np.copysign(self.deviations(score * score / size), score))


class Case:
    """Residuals of a calibration, and what the suspicions are made of."""

    def __init__(self, problem: Problem, estimate: Estimate, tables: Sequence[Measurements]) -> None:
        self.problem, self.estimate, self.tables = problem, estimate, tables
        self.theta = problem.theta(estimate.x)
        self.rows, self.robot = problem.rows, problem.cell.robot
        self.first = np.searchsorted(self.order, np.arange(len(self.rows.ids)))  # row of each measurement
        _, R, J = problem.cell.kinematics.pose_jacobian(self.rows.q[self.first], self.theta)
        self.lever = np.einsum("mk,mkj->mj", self.rows.normal, J[self.order, :3, :])  # [mm/rad] or 1
        self.along = np.einsum("mk,mk->m", self.rows.normal, R[self.order, :, 2])  # of the wire, on the normal
        self._residuals: dict[bytes, Residuals] = {}

    @property
    def order(self) -> Int[np.ndarray, " rows"]:
        """When each row was measured, counted."""
        return self.rows.owner

    def residuals(self, inliers: Bool[np.ndarray, " rows"]) -> Residuals:
        """Residuals of a least squares fit to some rows, about the solution; rows not used count nothing."""
        if inliers.tobytes() not in self._residuals:
            self._residuals[inliers.tobytes()] = self._fitted(inliers)
        return self._residuals[inliers.tobytes()]

    def _fitted(self, inliers: Bool[np.ndarray, " rows"]) -> Residuals:
        problem = self.problem
        parts = [part for _, _, part in problem.linearized(self.estimate.x)]
        r, weight = problem.residual(self.estimate.x), inliers / self.rows.sigma
        finite = np.flatnonzero(np.isfinite(problem.prior))
        m, n = len(r), len(problem.prior)
        A, b = np.zeros((m + len(finite), n)), np.empty(m + len(finite))
        np.multiply(np.concatenate(parts), weight[:, None], out=A[:m])
        A[m + np.arange(len(finite)), finite] = 1 / problem.prior[finite]
        b[:m], b[m:] = r * weight, (self.estimate.x / problem.prior)[finite]
        Q, _ = np.linalg.qr(A / np.maximum(np.sqrt((A * A).sum(axis=0)), 1e-300))
        rest = b - Q @ (Q.T @ b)
        freedom = np.count_nonzero(inliers) - float((Q[:m] ** 2).sum())  # of the measurements alone: priors may be wide
        scatter = float(np.sqrt((CERTAIN + rest[:m] @ rest[:m]) / (CERTAIN + max(freedom, 0.0))))
        degrees = CERTAIN + max(int(inliers.sum()) + len(finite) - n, 0)
        return Residuals(rest / scatter, Q, weight / scatter, CERTAIN / scatter**2, degrees)

    def many_left_out(self) -> bool:
        """Whether so many rows are left out that a fault may be among them."""
        return bool((~self.estimate.used).mean() > MANY)


def certainty(tried: int = 1) -> float:
    """Standard deviations from nothing that chance brings only with probability SURE, among so many trials."""
    return NormalDist().inv_cdf(1 - SURE / (2 * tried))


@dataclass(frozen=True, eq=False)
class Change:
    """What changed in time: its unknowns, its kind, and what is said of the values of the unknowns."""

    kind: str
    unknowns: tuple[Shared, ...]
    words: Callable[[np.ndarray, np.ndarray], str]  # by values and their standard deviations [mm]
    ids: tuple[str, ...]
    gain: float  # squares that it explains, in units of the scatter

    def finding(
        self, all_unknowns: Unknowns, values: Float[np.ndarray, " unknowns"], deviations: Float[np.ndarray, " unknowns"]
    ) -> Finding:
        """The change as estimated, in words; values and standard deviations of all unknowns [mm, rad]."""
        places = all_unknowns.index([unknown.name for unknown in self.unknowns])
        return Finding(self.kind, self.words(values[places], deviations[places]), self.ids)


def with_changes(
    problem: Problem, fit: Estimate, tables: Sequence[Measurements]
) -> tuple[Problem, Estimate, tuple[Change, ...]]:
    """The problem with all that changed in time as unknowns, the surest change first, and its estimate.

    Where many touches were left out, the fault may be among them: then all are asked too. A change stays if the
    measurements contradict each other less with it.
    """
    changes: tuple[Change, ...] = ()
    while len(changes) < LIMIT:
        case = Case(problem, fit, tables)
        everything = np.ones(len(case.rows), dtype=bool)
        cases = [case.residuals(fit.used), *([case.residuals(everything)] if case.many_left_out() else [])]
        residuals = max(cases, key=lambda some: abs(_cut(case, some)[2]) if len(cases) > 1 else 0.0)
        candidates = [some for some in (_stick_out(case, residuals), _drift(case, residuals)) if some is not None]
        surest = max(candidates, key=lambda some: some.gain, default=None)
        names = {unknown.name for change in changes for unknown in change.unknowns}
        if surest is None or surest.unknowns[0].name in names:
            break
        changed = problem.with_shared(surest.unknowns)
        starts = (estimate(changed, changed.start), estimate(changed, problem.theta(fit.x), fit.used))
        best = min(starts, key=lambda end: cost(changed, end))
        if cost(changed, best) > cost(problem, fit):  # gross errors, no change
            break
        problem, fit, changes = changed, best, (*changes, surest)
    return problem, fit, changes


def _stick_out(case: Case, residuals: Residuals) -> Change | None:
    """A wire that is longer or shorter from some touch on."""
    if not any(isinstance(table, Touches) for table in case.tables):  # there is no wire
        return None
    places, _, sure = _cut(case, residuals)
    if abs(sure) < certainty(len(case.rows.ids)):
        return None
    ids = tuple(case.rows.ids[i] for i in places)
    others = f", or from {' or '.join(ids[1:4])}" if len(ids) > 1 else ""

    def words(value: np.ndarray, deviation: np.ndarray) -> str:
        return (
            f"from touch {ids[0]} on{others}, the wire is {abs(value[0]):.2f} mm "
            f"{'longer' if value[0] > 0 else 'shorter'} (+- {INTERVAL * deviation[0]:.2f}, 95 %; {abs(sure):.0f} "
            "standard deviations): its length was estimated before and after; the tool of the calibration is that of "
            "the first touch"
        )

    return Change("stick-out changed", (stickout(ids[0], int(places[0])),), words, ids, sure**2)


def _cut(case: Case, residuals: Residuals) -> tuple[Int[np.ndarray, " touches"], float, float]:
    """Touches from which on another stick-out explains most, the best first; the change [mm], and how sure that is.

    After the best come those that the touches do not tell from it (likelihood ratio, 95 %): a touch across the wire
    does not feel its length.

    Sums from the end backwards give all touches at once.
    """
    b = case.along * residuals.unit
    by_touch = np.argsort(-case.order, kind="stable")

    def from_the_end(rows: np.ndarray) -> np.ndarray:
        ends = np.searchsorted(-case.order[by_touch], -np.arange(len(case.rows.ids)), side="right") - 1
        return np.cumsum(rows[by_touch], axis=0)[ends]

    Q, r = residuals.Q[: len(b)], residuals.r[: len(b)]
    shared = from_the_end(b[:, None] * Q)
    whole = from_the_end(b * b)
    size = whole - (shared * shared).sum(axis=1)
    visible = size > np.maximum(1e-6 * whole, 1e-12)
    score = np.where(visible, from_the_end(b * r), 0.0)
    sure = score / np.sqrt(np.where(visible, size, 1.0))
    best = int(np.argmax(np.abs(sure)))
    rest = np.maximum(1 - sure**2 / residuals.total, 1e-9)  # the change is part of the scatter, and leaves it with each
    near = np.flatnonzero(residuals.freedom * np.log(rest / rest[best]) < 3.84)
    change = -float(score[best] / size[best]) if visible[best] else 0.0
    return np.concatenate([[best], near[near != best]]), change, residuals.deviations(float(sure[best] ** 2))


def _drift(case: Case, residuals: Residuals) -> Change | None:
    """Base, jig or tracker that move while it is measured."""
    time, span = _times(case)
    unknowns = drift(time - 0.5)
    columns = case.rows.normal * (time[case.order] - 0.5)[:, None]
    ((gain, count),) = residuals.explained_by_each(columns[None])
    if count == 0 or (sure := residuals.deviations(gain, count)) < certainty():
        return None

    def words(value: np.ndarray, deviation: np.ndarray) -> str:
        way = ", ".join(
            f"{axis} {v:+.2f} +- {INTERVAL * s:.2f}" for axis, v, s in zip("xyz", value, deviation, strict=True)
        )
        return (
            f"the tip moves by ({way}) mm against the jig {span} (chi-square {gain:.0f} for {count}): the drift was "
            "estimated, and the calibration is of the middle of that time; warm up, and check that base, jig and tool "
            "are fast"
        )

    return Change("drift", unknowns, words, (), sure**2)


def _times(case: Case) -> tuple[Float[np.ndarray, " measured"], str]:
    """When each touch was made, from 0 to 1, and the span in words."""
    texts = [text for table in case.tables for text in (table.time if isinstance(table, Touches) else ("",))]
    try:
        seconds = np.array([datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp() for text in texts])
    except ValueError:
        seconds = np.empty(0)
    if len(seconds) != len(case.rows.ids) or np.ptp(seconds) == 0:
        return np.linspace(0, 1, len(case.rows.ids)), "from the first measurement to the last"
    return (seconds - seconds.min()) / np.ptp(seconds), f"in {np.ptp(seconds) / 60:.0f} minutes"
