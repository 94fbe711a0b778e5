"""Whether a robot is still the one that was identified: unchanged, drifted, or broken; by how much and how surely."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from jaxtyping import Float

from identify.estimation.verification import predicted, require_unseen
from identify.health.causes import Cause, causes
from identify.model.files import InputError
from identify.model.io.calibration_file import Calibration
from identify.model.measurement import measurement_model, rows
from identify.model.touch import Touches
from identify.uncertainty.posterior import posterior

LEAST = 6  # touches of a check
ALARM = 0.01  # chance that a robot which has not changed is said to have
DRAWS = 10_000  # of unchanged robots, for the level of all tests together
SPOILED = 5.0  # [mm], 1 sigma of a touch that went wrong
REST = 1e-3  # chance of what a cause leaves unexplained, below which it is not the whole of it

Verdict = Literal["unchanged", "drifted", "broken", "doubtful"]


@dataclass(frozen=True, eq=False)
class Finding:
    """One cause, and what speaks for it."""

    cause: Cause
    change: Float[np.ndarray, " freedoms"]  # [mm] or [rad]
    sigma: Float[np.ndarray, " freedoms"]
    sure: float  # probability beside the other causes


@dataclass(frozen=True, eq=False)
class Health:
    """What touches say about a robot that was identified before."""

    verdict: Verdict
    chance: float  # of residuals at least as telling where nothing has changed, all tests together
    findings: tuple[Finding, ...]  # the most probable first
    whole: bool  # whether the first explains all but what chance does
    residuals: dict[str, float]  # id -> distance from where the identified robot should have touched [mm]
    rms_expected_mm: float  # of these, of a robot that has not changed


def judge(calibration: Calibration, touches: Touches, alarm: float = ALARM) -> Health:
    """Compare touches with a calibration that has not seen them.

    Residuals are judged by their covariance, that of the touches and of the calibration: by their sum of squares, and
    by a score test for every cause (Rao 1948). `alarm` is the chance that any of them cries wolf; as the tests hang
    together, it is found by drawing robots that have not changed. Causes are compared by their evidence (MacKay 1992),
    one spoiled touch among them. Raises InputError where there are too few touches, or some that the fit has seen.
    """
    check = _Check.of(calibration, touches)
    fits = check.fits
    chances = np.array([check.overall(check.u[None])[0], *(fit.chance(check.u[None])[0] for fit in fits)])
    chance = check.together(float(chances.min()))
    findings = _findings(check, fits)
    best, rest = findings[0], check.rest(findings[0])
    verdict: Verdict = "unchanged" if chance >= alarm else VERDICTS.get(best.cause.kind, "drifted")
    residuals = dict(zip(touches.ids, check.r.tolist(), strict=True))
    return Health(
        "doubtful" if verdict != "unchanged" and best.cause.name.startswith(TOUCH) else verdict,
        chance,
        findings,
        rest >= REST,
        residuals,
        float(np.sqrt(np.trace(check.S) / len(check.S))),
    )


TOUCH = "touch "  # before the id of a touch that went wrong
VERDICTS: dict[str, Verdict] = {"tool": "broken"}


def noticed(calibration: Calibration, touches: Touches, alarm: float = ALARM) -> dict[str, float]:
    """The smallest change of each cause of one freedom [mm] or [rad] that 95 of 100 such checks would notice.

    Of the tool, the smallest that they would notice in its worst direction. Infinite where touches do not show it.
    """
    check = _Check.of(calibration, touches, unseen=False)
    level = _quantile(1 - alarm / (2 * (len(check.fits) + 1))) + _quantile(0.95)
    out = {}
    for fit in check.fits:
        weakest = np.linalg.svd(fit.A, compute_uv=False)[-1]
        if fit.cause.kind in {"zero", "wire", "tool"}:
            out[fit.cause.name] = float(level / weakest) if weakest > 1e-9 else float("inf")
    return out


def _quantile(p: float) -> float:
    from statistics import NormalDist

    return NormalDist().inv_cdf(p)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A cause as the touches see it."""

    cause: Cause
    A: Float[np.ndarray, "touches freedoms"]  # whitened residuals a unit of change

    @cached_property
    def Q(self) -> Float[np.ndarray, "touches rank"]:
        """An orthonormal basis of what it can do to the residuals, as far as a usual change is seen."""
        U, s, _ = np.linalg.svd(self.A * self.cause.size, full_matrices=False)
        return U[:, s > 1e-3]

    def chance(self, u: Float[np.ndarray, "many touches"]) -> Float[np.ndarray, " many"]:
        """Of whitened residuals that this cause explains so well, where there is none (chi-square)."""
        from scipy.special import chdtrc

        rank = self.Q.shape[1]
        return np.asarray(chdtrc(rank, ((u @ self.Q) ** 2).sum(axis=1))) if rank else np.ones(len(u))


@dataclass(frozen=True, eq=False)
class _Check:
    """Residuals at the identified parameters, their covariance, and the causes."""

    calibration: Calibration
    ids: tuple[str, ...]
    r: Float[np.ndarray, " touches"]
    J: Float[np.ndarray, "touches parameters"]
    S: Float[np.ndarray, "touches touches"]

    @classmethod
    def of(cls, calibration: Calibration, touches: Touches, unseen: bool = True) -> "_Check":
        cell = calibration.cell
        equations = rows(cell.wire, [touches], cell.robot)
        if len(equations) < LEAST:
            raise InputError(
                f"{len(equations)} touches are too few to judge a robot by; make {LEAST} at least, better 12"
            )
        if unseen:
            require_unseen(calibration, equations, "they cannot tell a change; touch again")
        _, J = measurement_model(cell.robot).linearize(calibration.theta, equations)
        r, prior = predicted(calibration, equations)[0], posterior(calibration)
        B = equations.sigma[:, None] * prior.root(prior.unknowns.rows(equations, calibration.theta))
        return cls(calibration, touches.ids, r, J, B @ B.T + np.diag((equations.sigma * calibration.noise) ** 2))

    @cached_property
    def W(self) -> Float[np.ndarray, "touches touches"]:
        return np.linalg.inv(np.linalg.cholesky(self.S))

    @cached_property
    def u(self) -> Float[np.ndarray, " touches"]:
        return self.W @ self.r

    @cached_property
    def fits(self) -> list[_Fit]:
        """All causes."""
        return [_Fit(cause, self.W @ self.J @ cause.directions) for cause in causes(self.calibration)]

    @cached_property
    def spoiled(self) -> list[_Fit]:
        """Each touch, gone wrong; they are causes, but no tests of their own."""
        weight, none = 1 / len(self.ids), np.zeros((self.J.shape[1], 1))
        return [
            _Fit(Cause(f"{TOUCH}{name}", "parameter", none, np.array([SPOILED]), weight), self.W[:, [i]])
            for i, name in enumerate(self.ids)
        ]

    def overall(self, u: Float[np.ndarray, "many touches"]) -> Float[np.ndarray, " many"]:
        """Chance of residuals so large at all, where nothing has changed."""
        from scipy.special import chdtrc

        return np.asarray(chdtrc(u.shape[1], (u * u).sum(axis=1)))

    def together(self, least: float) -> float:
        """Chance that any test is as telling as the most telling one was, where nothing has changed."""
        bases = np.concatenate([fit.Q for fit in self.fits], axis=1)
        lowest = _lowest(len(self.r), tuple(fit.Q.shape[1] for fit in self.fits), bases.tobytes())
        return float((1 + (lowest <= least).sum()) / (1 + DRAWS))

    def rest(self, finding: Finding) -> float:
        """Chance of what a cause leaves of the residuals."""
        from scipy.special import chdtrc

        Q = next(fit.Q for fit in [*self.fits, *self.spoiled] if fit.cause.name == finding.cause.name)
        remainder = self.u - Q @ (Q.T @ self.u)
        return float(chdtrc(max(len(remainder) - Q.shape[1], 1), remainder @ remainder))


@lru_cache(maxsize=4)
def _lowest(touches: int, ranks: tuple[int, ...], bases: bytes) -> Float[np.ndarray, " draws"]:
    """The least chance that any test gives to robots that have not changed; `bases` are those of all causes."""
    from scipy.special import chdtrc

    u = np.random.default_rng(0).standard_normal((DRAWS, touches))
    parts = np.split((u @ np.frombuffer(bases).reshape(touches, -1)) ** 2, np.cumsum(ranks)[:-1], axis=1)
    largest = {
        rank: np.maximum.reduce([part.sum(axis=1) for part in parts if part.shape[1] == rank])
        for rank in sorted({*ranks} - {0})
    }
    chances = [chdtrc(rank, size) for rank, size in largest.items()]
    return np.asarray(np.minimum.reduce([chdtrc(touches, (u * u).sum(axis=1)), *chances]))


def _findings(check: _Check, fits: list[_Fit]) -> tuple[Finding, ...]:
    """All causes by their evidence: how well they explain the residuals, for how freely they may choose."""
    everything = [*fits, *check.spoiled]
    evidence, change, sigma = np.empty(len(everything)), list[np.ndarray](), list[np.ndarray]()
    for i, fit in enumerate(everything):
        A = fit.A * fit.cause.size
        H, b = A.T @ A + np.eye(A.shape[1]), A.T @ check.u
        x = np.linalg.solve(H, b)
        evidence[i] = 0.5 * b @ x - 0.5 * np.linalg.slogdet(H)[1] + np.log(fit.cause.weight)
        change.append(-x * fit.cause.size)
        sigma.append(np.sqrt(np.diag(np.linalg.inv(H))) * fit.cause.size)
    sure = np.exp(evidence - evidence.max())
    sure /= sure.sum()
    return tuple(
        Finding(everything[i].cause, change[i], sigma[i], float(sure[i])) for i in np.argsort(-sure, kind="stable")
    )
