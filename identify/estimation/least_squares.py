"""Weighted, robust nonlinear least squares with priors, solved by Ipopt with the Gauss-Newton Hessian.

One evaluation of residuals and Jacobian serves the objective, its gradient and its Hessian: Ipopt asks for all three at
the same point, and they share what was computed there.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from identify.estimation.ipopt import minimize

UNNOTICED = 0.02  # of the objective, half a chi-square: the worst direction is right to a fifth of its deviation
NEAR, EXACT = 0.3, 1e-4  # [standard deviations], gradients at which Ipopt stops: asked for less it drowns in rounding
THERE = 1e-3  # [standard deviations] to the minimum: nobody asks for more
NEARLY = 0.03  # [standard deviations], where a linear problem stands for another
STEPS, WALK = 2, 10  # of Newton: at the end, 1 is usual; without Ipopt
SOLVED = "Solve_Succeeded"
Part = tuple[slice, Float[np.ndarray, " rows"], Float[np.ndarray, "rows unknowns"]]


def _linear(r2: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    one = np.ones_like(r2)
    return r2, one, one


def _huber(r2: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quadratic up to 1.345 sigma, linear beyond: 95 % efficient for normal errors (Huber 1964)."""
    k = 1.345
    size = np.maximum(np.sqrt(r2), k)
    inside = r2 <= k * k
    slope = k / size
    return np.where(inside, r2, 2 * k * size - k * k), slope, inside.astype(float)


def _cauchy(r2: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Logarithmic: far rows lose all weight; 95 % efficient for normal errors at 2.385 sigma."""
    u = r2 / 2.385**2
    slope = 1 / (1 + u)
    return 2.385**2 * np.log1p(u), slope, np.maximum(1 - u, 0) * slope**2


LOSSES: dict[str, Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]] = {
    "huber": _huber,
    "linear": _linear,
    "cauchy": _cauchy,
}
"""Loss, weight of the gradient and weight of the Hessian, as functions of squared residuals in units of sigma."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Where Ipopt stopped, and how."""

    x: Float[np.ndarray, " unknowns"]
    iterations: int
    status: str
    seconds: float

    @property
    def converged(self) -> bool:
        """Whether the optimality conditions hold."""
        return self.status in {SOLVED, "Solved_To_Acceptable_Level"}


@dataclass(eq=False)
class Objective:
    """Half the sum of losses of weight r(x), plus half of (x / prior)^2.

    `linearize` gives residuals and their Jacobian, part by part so that memory stays bounded whatever the number of
    rows; `weight` is one over sigma, a number a row.
    """

    linearize: Callable[[np.ndarray], Iterable[Part]]
    prior: Float[np.ndarray, " unknowns"]  # standard deviations, infinite where nothing is known
    weight: Float[np.ndarray, " rows"]
    loss: str = "linear"
    _at: np.ndarray = field(default_factory=lambda: np.empty(0))
    _value: float = 0.0
    _gradient: np.ndarray = field(default_factory=lambda: np.empty(0))
    _hessian: np.ndarray = field(default_factory=lambda: np.empty(0))

    def reweigh(self, weight: Float[np.ndarray, " rows"], loss: str) -> None:
        """Change the weights of the rows and the loss."""
        if loss != self.loss or not np.array_equal(weight, self.weight):
            self.weight, self.loss, self._at = weight, loss, np.empty(0)

    def at(self, x: Float[np.ndarray, " unknowns"]) -> tuple[float, np.ndarray, np.ndarray]:
        """Value, gradient and Gauss-Newton Hessian."""
        if not np.array_equal(x, self._at):
            precision = 1 / self.prior**2
            self._value, self._gradient, self._hessian = (
                0.5 * float(precision @ (x * x)),
                precision * x,
                np.diag(precision),
            )
            for part, r, J in self.linearize(x):
                w = self.weight[part]
                value, slope, curve = LOSSES[self.loss]((w * r) ** 2)
                A = J * (w * np.sqrt(curve))[:, None]  # A'A costs half of what a product of two matrices does
                self._value += 0.5 * float(value.sum())
                self._gradient = self._gradient + J.T @ (w * w * slope * r)
                self._hessian = self._hessian + A.T @ A
            self._at = x.copy()
        return self._value, self._gradient, self._hessian


class LeastSquares:
    """An objective handed to Ipopt; solved as often as weights, losses and starts change.

    Ipopt sees combinations of the unknowns that are independent at the start, in units of their standard deviations, so
    the gradient says how many of these it is to the end. Where it comes NEAR, one or two Newton steps are left that
    need no search, and what they reach is looked at; else Ipopt goes on until it is there.
    """

    def __init__(
        self,
        objective: Objective,
        start: Float[np.ndarray, " unknowns"],
        lower: Float[np.ndarray, " unknowns"] | None = None,
        upper: Float[np.ndarray, " unknowns"] | None = None,
    ) -> None:
        self.objective = objective
        n = len(start)
        self.lower = np.full(n, -np.inf) if lower is None else lower
        self.upper = np.full(n, np.inf) if upper is None else upper
        hessian = objective.at(start)[2]
        self._free = bool(np.isinf([self.lower, self.upper]).all())
        self._basis = _whitener(hessian) if self._free else _scales(hessian)

    def solve(self, start: Float[np.ndarray, " unknowns"]) -> Solution:
        """Minimise from a start."""
        import time

        begin = time.perf_counter()
        x, status, iterations = self._minimized(start, NEAR if self._free else EXACT)
        if self._free and status == SOLVED:
            x, steps, rest = self._polished(x, STEPS, THERE)
            iterations += steps
            if not rest < THERE:
                x, status, more = self._minimized(x, EXACT)
                iterations += more
        if status == "Solved_To_Acceptable_Level" and not self._stalled(x):
            status = "Stopped_Without_Progress"
        return Solution(x, iterations, status, time.perf_counter() - begin)

    def _minimized(
        self, start: Float[np.ndarray, " unknowns"], tolerance: float
    ) -> tuple[Float[np.ndarray, " unknowns"], str, int]:
        """Where Ipopt stops, why, and after how many iterations."""
        x, stats = minimize(self.objective.at, self._basis, start, self.lower, self.upper, tolerance)
        return x, str(stats["return_status"]), int(stats["iter_count"])

    def near(
        self, objective: Objective, start: Float[np.ndarray, " unknowns"]
    ) -> Float[np.ndarray, " unknowns"] | None:
        """The minimum of an objective like this one, if Newton steps alone lead there, each shorter than the last."""
        x, _, rest = self._polished(start, WALK, NEARLY, objective)
        return x if rest < NEARLY else None

    def _polished(
        self, x: Float[np.ndarray, " unknowns"], most: int, enough: float, objective: Objective | None = None
    ) -> tuple[Float[np.ndarray, " unknowns"], int, float]:
        """Where some Newton steps lead, each shorter than the one before; their number; the size of the next."""
        step, size = self._newton(x, objective)
        for count in range(most):
            if size < enough:
                return x, count, size
            further, less = self._newton(x + step, objective)
            if not less < size:
                return x, count, size
            x, step, size = x + step, further, less
        return x, most, size

    def _newton(
        self, x: Float[np.ndarray, " unknowns"], objective: Objective | None = None
    ) -> tuple[Float[np.ndarray, " unknowns"], float]:
        """The Newton step, and its size in standard deviations; infinite where the Hessian has no inverse."""
        _, gradient, hessian = (objective or self.objective).at(x)
        T = self._basis
        g, H = gradient @ T, T.T @ hessian @ T
        try:
            step = -np.linalg.solve(H, g)
        except np.linalg.LinAlgError:
            return np.zeros_like(x), np.inf
        square = -float(g @ step)
        return T @ step, np.sqrt(square) if square >= 0 else np.inf

    def _stalled(self, x: Float[np.ndarray, " unknowns"]) -> bool:
        """Whether no part of the Newton step lowers the objective by more than chance would notice."""
        value, gradient, hessian = self.objective.at(x)
        step = -np.linalg.solve(hessian, gradient)
        ends = (np.clip(x + share * step, self.lower, self.upper) for share in (1.0, 0.3, 0.1, 0.03, 0.01))
        return all(self.objective.at(end)[0] > value - UNNOTICED for end in ends)


def _scales(hessian: Float[np.ndarray, "unknowns unknowns"]) -> Float[np.ndarray, "unknowns unknowns"]:
    """Unknowns in units of their standard deviations, the others being known."""
    return np.diag(1 / np.sqrt(np.diag(hessian)))


def _whitener(hessian: Float[np.ndarray, "unknowns unknowns"]) -> Float[np.ndarray, "unknowns unknowns"]:
    """Combinations of unknowns whose deviations are one and independent: the upper T with T'HT = 1."""
    scale = _scales(hessian)
    try:
        return scale @ np.linalg.inv(np.linalg.cholesky(scale @ hessian @ scale)).T
    except np.linalg.LinAlgError:  # nothing sees some direction
        return scale
