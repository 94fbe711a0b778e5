"""What residuals give away: joints read too early, drift, a wire cut between touches, one bad joint; with the evidence.

Every suspicion is a column that the model does not have. It is held against the residuals with all that parameters and
priors explain taken out of it (a score test, Rao 1948), so a suspicion that the parameters could carry is no evidence.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import fdtrc, ndtri

from identify.estimation.problem import Problem
from identify.estimation.robust import CERTAIN, Estimate
from identify.model.io.calibration_file import Finding
from identify.model.measurement import Measurements
from identify.model.touch import Positions, Touches

SURE = 1e-5  # chance that touches without fault are accused of one
SHARE = 0.2  # of the residuals' squares that one joint explains, to be called bad
TWICE = 2.0  # as much as any other joint does
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
        kept = np.abs(np.diagonal(R, axis1=1, axis2=2)) > 1e-6
        return [basis[:, some] for basis, some in zip(new, kept, strict=True)]

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


_Change = tuple[float, np.ndarray, Finding]  # how much it explains, by which columns, and in words


def diagnose(problem: Problem, estimate: Estimate, tables: Sequence[Measurements]) -> tuple[Finding, ...]:
    """What is wrong with touches or robot, as far as residuals tell."""
    case = _Case(problem, estimate, tables)
    residuals, changes = _changes(case)
    return (*changes, *_unsettled(case), *_joint(case, residuals), *_outliers(case))


class _Case:
    """Residuals of a calibration, and what the suspicions are made of."""

    def __init__(self, problem: Problem, estimate: Estimate, tables: Sequence[Measurements]) -> None:
        self.problem, self.estimate, self.measured = problem, estimate, tables
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

    def residuals(self, used: Bool[np.ndarray, " rows"]) -> Residuals:
        """Residuals of a least squares fit to some rows, about the solution; rows not used count nothing."""
        if used.tobytes() not in self._residuals:
            self._residuals[used.tobytes()] = self._fitted(used)
        return self._residuals[used.tobytes()]

    def _fitted(self, used: Bool[np.ndarray, " rows"]) -> Residuals:
        problem = self.problem
        parts = [part for _, _, part in problem.linearized(self.estimate.x)]
        r, weight = problem.residual(self.estimate.x), used / self.rows.sigma
        known = np.flatnonzero(np.isfinite(problem.prior))
        m, n = len(r), len(problem.prior)
        A, b = np.zeros((m + len(known), n)), np.empty(m + len(known))
        np.multiply(np.concatenate(parts), weight[:, None], out=A[:m])
        A[m + np.arange(len(known)), known] = 1 / problem.prior[known]
        b[:m], b[m:] = r * weight, (self.estimate.x / problem.prior)[known]
        Q, _ = np.linalg.qr(A / np.maximum(np.sqrt((A * A).sum(axis=0)), 1e-300))
        left = b - Q @ (Q.T @ b)
        freedom = np.count_nonzero(used) - float((Q[:m] ** 2).sum())  # of the measurements alone: priors may be wide
        scatter = float(np.sqrt((CERTAIN + left[:m] @ left[:m]) / (CERTAIN + max(freedom, 0.0))))
        degrees = CERTAIN + max(int(used.sum()) + len(known) - n, 0)
        return Residuals(left / scatter, Q, weight / scatter, CERTAIN / scatter**2, degrees)

    def many_left_out(self) -> bool:
        return bool((~self.estimate.used).mean() > MANY)


def _sure(tried: int = 1) -> float:
    """Standard deviations from nothing that chance brings only with probability SURE, among so many trials."""
    return NormalDist().inv_cdf(1 - SURE / (2 * tried))


def _changes(case: _Case) -> tuple[Residuals, list[Finding]]:
    """What changed in time, one thing after the other, the surest first; and the residuals without it.

    Where many touches were left out, the fault may be among them: then all are asked too.
    """
    everything = np.ones(len(case.rows), dtype=bool)
    asked = [case.estimate.used, *([everything] if case.many_left_out() else [])]
    residuals = max(map(case.residuals, asked), key=lambda some: abs(_cut(case, some)[2]) if len(asked) > 1 else 0.0)
    findings: list[Finding] = []
    for _ in range(LIMIT):
        cut, drift = _stick_out(case, residuals), _drift(case, residuals)
        told = max((some for some in (cut, drift) if some is not None), key=lambda some: some[0], default=None)
        if told is None:
            break
        residuals = residuals.without(told[1])
        findings.append(told[2])
    return residuals, findings


def _stick_out(case: _Case, residuals: Residuals) -> _Change | None:
    """A wire that is longer or shorter from some touch on."""
    if not any(isinstance(table, Touches) for table in case.measured):  # there is no wire
        return None
    places, change, sure = _cut(case, residuals)
    if abs(sure) < _sure(len(case.rows.ids)):
        return None
    names = tuple(case.rows.ids[i] for i in places)
    others = f", or from {' or '.join(names[1:4])}" if len(names) > 1 else ""
    finding = Finding(
        "stick-out changed",
        f"from touch {names[0]} on{others}, the wire is {abs(change):.2f} mm {'longer' if change > 0 else 'shorter'} "
        f"({abs(sure):.0f} standard deviations); identify the touches before and after it apart, or touch again",
        names,
    )
    return sure**2, (case.along * (case.order >= places[0]))[:, None], finding


def _cut(case: _Case, residuals: Residuals) -> tuple[Int[np.ndarray, " touches"], float, float]:
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
    seen = size > np.maximum(1e-6 * whole, 1e-12)
    score = np.where(seen, from_the_end(b * r), 0.0)
    sure = score / np.sqrt(np.where(seen, size, 1.0))
    best = int(np.argmax(np.abs(sure)))
    left = np.maximum(1 - sure**2 / residuals.total, 1e-9)  # the change is part of the scatter, and leaves it with each
    near = np.flatnonzero(residuals.freedom * np.log(left / left[best]) < 3.84)
    change = -float(score[best] / size[best]) if seen[best] else 0.0
    return np.concatenate([[best], near[near != best]]), change, residuals.deviations(float(sure[best] ** 2))


def _unsettled(case: _Case) -> Iterator[Finding]:
    """Joints read before they stood: they lag on the way from the measurement before."""
    if not all(isinstance(table, Positions) for table in case.measured):
        return
    stands = case.rows.q[case.first]
    step = np.diff(stands, axis=0, prepend=stands[:1])
    ways = case.lever * step[case.order]
    residuals = case.residuals(np.ones(len(case.rows), dtype=bool)).without(case.lever * case.rows.q)  # gears
    lag, sure = residuals.amount(ways.sum(axis=1))
    if -sure < _sure():
        return
    still_to_go = np.abs(lag * step / case.robot.joint_unit())
    yield Finding(
        "joints read too early",
        f"the arm was on {-100 * lag:.3f} % of the way from the position before when its joints were read, up to "
        f"{still_to_go.max():.3f} deg ({-sure:.0f} standard deviations): wait until it stands, or use the commanded "
        "joint values",
    )


def _drift(case: _Case, residuals: Residuals) -> _Change | None:
    """Base, jig or tracker that move while it is measured."""
    time, span = _times(case)
    columns = case.rows.normal * (time[case.order] - 0.5)[:, None]
    ((gain, count),) = residuals.explained_by_each(columns[None])
    if count == 0 or (sure := residuals.deviations(gain, count)) < _sure():
        return None
    way = ", ".join(f"{axis} {-amount:+.2f}" for axis, amount in zip("xyz", residuals.fit(columns), strict=True))
    finding = Finding(
        "drift",
        f"the tip moves by ({way}) mm against the jig {span} (chi-square {gain:.0f} for {count}): warm up, and check "
        "that base, jig and tool are fast",
    )
    return sure**2, columns, finding


def _times(case: _Case) -> tuple[Float[np.ndarray, " measured"], str]:
    """When each touch was made, from 0 to 1, and the span in words."""
    texts = [text for table in case.measured for text in (table.time if isinstance(table, Touches) else ("",))]
    try:
        seconds = np.array([datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp() for text in texts])
    except ValueError:
        seconds = np.empty(0)
    if len(seconds) != len(case.rows.ids) or np.ptp(seconds) == 0:
        return np.linspace(0, 1, len(case.rows.ids)), "from the first measurement to the last"
    return (seconds - seconds.min()) / np.ptp(seconds), f"in {np.ptp(seconds) / 60:.0f} minutes"


def _joint(case: _Case, residuals: Residuals) -> Iterator[Finding]:
    """One joint that turns unevenly, far more than all others."""
    total = float(residuals.r @ residuals.r)
    q = case.rows.q / np.where(case.robot.prismatic, 100.0, 1.0)
    shapes = np.stack([q, np.cos(q), np.sin(q), np.cos(2 * q), np.sin(2 * q)], axis=2)
    gains = residuals.explained_by_each((case.lever[:, :, None] * shapes).transpose(1, 0, 2))
    best = int(np.argmax([gain for gain, _ in gains]))
    (gain, count), others = gains[best], max([g for k, (g, _) in enumerate(gains) if k != best], default=0.0)
    if count == 0 or residuals.deviations(gain, count) < _sure() or gain < max(SHARE * total, TWICE * others):
        return
    yield Finding(
        "one bad joint",
        f"{case.robot.joints[best].name} turns unevenly: that alone explains {100 * gain / total:.0f} % of the "
        f"residuals' squares, any other joint at most {100 * others / total:.0f} %; look at its gear and encoder, or "
        "identify with --errors auto",
    )


def _outliers(case: _Case) -> Iterator[Finding]:
    """Touches that were left out."""
    out = np.unique(case.rows.owner[~case.estimate.used & case.rows.counted])
    if not len(out):
        return
    r = case.problem.residual(case.estimate.x)
    worst = int(np.argmax(np.where(~case.estimate.used & case.rows.counted, np.abs(r), 0.0)))
    names = tuple(case.rows.ids[i] for i in out)
    yield Finding(
        "outliers",
        f"{len(names)} of {len(case.rows.ids)} measurements disagree with all others and were left out, the worst, "
        f"{case.rows.ids[case.rows.owner[worst]]}, by {r[worst]:+.2f} mm",
        names,
    )
