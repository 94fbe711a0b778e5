"""Least squares on the measurements that agree: robust fits find those that do not, and they are left out."""

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float

from identify.estimation.least_squares import Objective, Solution
from identify.estimation.problem import PART, CalibrationFailed, Problem

FALSE_ALARM = 0.01  # chance that one of all good touches is called an outlier
SURE = 0.98  # of the limit of an outlier: closer to it a robust fit decides
ROUNDS = 6  # of robust fits
CAP = 25.0  # squares of residuals beyond it count no more, in units of sigma
CERTAIN = 10.0  # degrees of freedom that the stated sigma is worth


@dataclass(frozen=True, eq=False)
class Estimate:
    """An estimate, the rows that it rests on, and what it took."""

    x: Float[np.ndarray, " size"]
    used: Bool[np.ndarray, " rows"]
    weight: Float[np.ndarray, " rows"]  # 1 / (sigma noise), 0 where not used
    noise: float  # in units of sigma, as sigma and residuals say together
    iterations: int
    seconds: float


def estimate(
    problem: Problem,
    start: Float[np.ndarray, " parameters"] | None = None,
    inliers: Bool[np.ndarray, " rows"] | None = None,
) -> Estimate:
    """The estimate of a problem from a start, or from its own; raises CalibrationFailed if Ipopt does not converge.

    With `inliers`, rows that agree with each other, the others join as far as they agree: no robust loss is needed.
    """
    fit = _Fit(problem)
    x = np.zeros(problem.size) if start is None else problem.coordinates(start)
    return fit.estimate(x) if inliers is None else fit.grown(x, inliers)


def cost(problem: Problem, fit: Estimate) -> float:
    """Capped squares of residuals and squares of what priors hold, in units of the stated sigma."""
    square = np.minimum((problem.residual(fit.x) / problem.rows.sigma) ** 2, CAP).sum()
    return float(square + ((fit.x / problem.prior) ** 2).sum())


def limit(rows: int) -> float:
    """Standard deviations that one of so many good rows exceeds with probability FALSE_ALARM."""
    return NormalDist().inv_cdf(1 - FALSE_ALARM / (2 * rows))


def scatter(problem: Problem, estimate: Estimate) -> tuple[float, bool]:
    """Scatter in units of sigma, and whether chance explains its distance from 1 (Wilson and Hilferty 1931)."""
    fit = _Fit(problem)
    freedom, deviation = fit.freedom(estimate.x, estimate.weight), fit.deviation(estimate.x, estimate.used)
    if freedom < 1:
        return deviation, False
    normal = (deviation ** (2 / 3) - (1 - 2 / (9 * freedom))) / np.sqrt(2 / (9 * freedom))
    return deviation, bool(abs(normal) > NormalDist().inv_cdf(0.995))


class _Fit:
    """The robust fits of one problem."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.rows = problem, problem.rows
        self.limit = limit(len(problem.rows))
        self._freedom_at = b"", 0.0

    def estimate(self, x: Float[np.ndarray, " size"]) -> Estimate:
        """Least squares on the rows that agree."""
        problem, weight, inliers = self.problem, 1 / self.rows.sigma, self.rows.counted
        solutions, weighed = [self._first(x, weight)], weight
        near, unanimous = self.foreseen(solutions[-1].x, weight)
        for _ in range(0 if unanimous else ROUNDS):
            scale = self._scale(solutions[-1].x, inliers)
            solutions.append(problem.solve(near, weight / scale, problem.loss))
            near = solutions[-1].x
            agreeing = self._agreeing(solutions[-1].x, weight / self._scale(solutions[-1].x, inliers))
            weighed = np.zeros_like(weight)  # by no plain fit
            if np.array_equal(agreeing, inliers):
                break
            inliers = agreeing
        return self._finished(solutions, inliers, weighed)

    def grown(self, x: Float[np.ndarray, " size"], inliers: Bool[np.ndarray, " rows"]) -> Estimate:
        """Least squares on rows that agree with each other, and on all that agree with these."""
        solutions, weight = list[Solution](), 1 / self.rows.sigma
        for _ in range(2 * ROUNDS):
            solutions.append(self.problem.solve(x, weight * inliers, "linear"))
            x = solutions[-1].x
            agreeing = self._agreeing(x, weight * inliers / max(self.noise(x, inliers), 1.0), weight)
            if np.array_equal(agreeing, inliers):
                break
            inliers = agreeing
        return self._finished(solutions, inliers, weight * inliers)

    def _finished(
        self, solutions: list[Solution], inliers: Bool[np.ndarray, " rows"], weighed: Float[np.ndarray, " rows"]
    ) -> Estimate:
        """The estimate on these rows with the noise that sigma and residuals say together."""
        problem, weight, noise = self.problem, 1 / self.rows.sigma, 1.0
        for _ in range(2):  # the noise sets how much the priors weigh, and the priors change the noise a little
            noise = self.noise(solutions[-1].x, inliers)
            final = weight * inliers / noise
            if np.allclose(final, weighed, rtol=1e-3):
                break
            solutions.append(problem.solve(solutions[-1].x, final, "linear"))
            weighed = final
        iterations, seconds = sum(s.iterations for s in solutions), sum(s.seconds for s in solutions)
        return Estimate(solutions[-1].x, inliers, weighed, noise, iterations, seconds)

    def _first(self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"]) -> Solution:
        """Plain least squares; if touches far from all others keep these from an end, the robust loss at once."""
        try:
            return self.problem.solve(x, weight, "linear")
        except CalibrationFailed:
            if self.problem.loss == "linear":
                raise
            return self.problem.solve(x, weight, self.problem.loss)

    def foreseen(
        self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"]
    ) -> tuple[Float[np.ndarray, " size"], bool]:
        """Where a robust fit will end, by the equations as they are near a plain one, linear; whether all agree there.

        If they clearly do, the robust fit of the equations themselves need not be made.
        """
        problem = self.problem
        if problem.loss == "linear":
            return x, True
        if len(self.rows) > PART:
            return x, False
        ((part, r, J),) = problem.linearized(x)
        everyone = np.ones(len(r), dtype=bool)
        scaled = weight / self._scale(x, everyone)
        nearby = Objective(lambda y: [(part, r + J @ (y - x), J)], problem.prior, scaled, problem.loss)
        y = problem.solver.near(nearby, x)
        if y is None:
            return x, False
        rest = r + J @ (y - x)
        sizes = self._sizes(x, weight / self._scale(x, everyone, rest), rest)
        return y, bool((sizes <= SURE * self.limit).all())

    def _scale(
        self,
        x: Float[np.ndarray, " size"],
        inliers: Bool[np.ndarray, " rows"],
        residual: Float[np.ndarray, " rows"] | None = None,
    ) -> float:
        """Robust scatter in units of sigma, at least 1: the median absolute residual, corrected for the parameters."""
        r = ((self.problem.residual(x) if residual is None else residual) / self.rows.sigma)[inliers]
        freedom = max(self.freedom(x, inliers / self.rows.sigma), 1)
        return max(1.0, 1.4826 * float(np.median(np.abs(r))) * np.sqrt(len(r) / freedom))

    def _agreeing(
        self,
        x: Float[np.ndarray, " size"],
        weight: Float[np.ndarray, " rows"],
        judged: Float[np.ndarray, " rows"] | None = None,
    ) -> Bool[np.ndarray, " rows"]:
        """Rows of touches whose residual is within what chance makes of a good touch, leverage considered.

        If rows without weight are `judged` as well, by the weights that they would have, they are predictions.
        """
        return (self._sizes(x, weight, judged=judged) <= self.limit)[self.rows.owner] & self.rows.counted

    def _sizes(
        self,
        x: Float[np.ndarray, " size"],
        weight: Float[np.ndarray, " rows"],
        residual: Float[np.ndarray, " rows"] | None = None,
        judged: Float[np.ndarray, " rows"] | None = None,
    ) -> Float[np.ndarray, " measured"]:
        """The largest residual of each touch in units of what chance makes of a good one, leverage considered."""
        scale = weight if judged is None else np.where(weight > 0, weight, judged * weight.max() / judged.max())
        C, size = self.problem.covariance(x, weight), np.empty(len(self.rows))
        for part, r, J in self.problem.linearized(x):
            w = scale[part]
            leverage = w**2 * ((J @ C) * J).sum(axis=1)
            own = np.where(weight[part] > 0, np.clip(1 - leverage, 0.05, 1), 1 + leverage)
            size[part] = np.abs(r if residual is None else residual[part]) * w / np.sqrt(own)
        worst = np.zeros(len(self.rows.ids))
        np.maximum.at(worst, self.rows.owner, size)
        return worst

    def noise(self, x: Float[np.ndarray, " size"], inliers: Bool[np.ndarray, " rows"]) -> float:
        """Noise in units of sigma, root of the mean of its posterior (scaled inverse chi-square).

        Sigma is worth ten degrees of freedom, the residuals those that they have.
        """
        freedom = max(self.freedom(x, inliers / self.rows.sigma), 1.0)
        square = self.deviation(x, inliers) ** 2
        return float(np.sqrt((CERTAIN + freedom * square) / (CERTAIN + freedom - 2)))

    def deviation(self, x: Float[np.ndarray, " size"], inliers: Bool[np.ndarray, " rows"]) -> float:
        """Root of chi-square a degree of freedom, in units of sigma."""
        r = (self.problem.residual(x) / self.rows.sigma)[inliers]
        return float(np.sqrt(r @ r / max(self.freedom(x, inliers / self.rows.sigma), 1)))

    def freedom(self, x: Float[np.ndarray, " size"], weight: Float[np.ndarray, " rows"]) -> float:
        """Rows in use less the coordinates that they, and not the priors, determine."""
        problem, key = self.problem, x.tobytes() + weight.tobytes()
        if key != self._freedom_at[0]:
            determined = float(problem.size)
            if np.isfinite(problem.prior).any():
                P = problem.precision(x, weight)
                determined -= float(np.diag(np.linalg.inv(P)) @ (1 / problem.prior**2))
            self._freedom_at = key, np.count_nonzero(weight) - determined
        return self._freedom_at[1]
