"""Weighted, robust nonlinear least squares with priors, solved by Ipopt with the Gauss-Newton Hessian.

One evaluation of residuals and Jacobian serves the objective, its gradient and its Hessian: Ipopt asks for all three at
the same point, and they share what was computed there.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

ITERATIONS = 200  # of Ipopt; a calibration takes 3 to 30
UNNOTICED = 0.02  # of the objective, half a chi-square: the worst direction is right to a fifth of its deviation
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
        return self.status in {"Solve_Succeeded", "Solved_To_Acceptable_Level"}


@dataclass(eq=False)
class Objective:
    """Half the sum of losses of weight r(x), plus half of (x / prior)^2, scaled to unit curvature along each unknown.

    `linearize` gives residuals and their Jacobian, part by part so that memory stays bounded whatever the number of
    rows; `weight` is one over sigma, a number a row. The unknowns that Ipopt sees are z = x * norm of their column, so
    a gradient of 1e-4 is a ten-thousandth of a standard deviation where columns are independent; asked for much less,
    the line search drowns in rounding.
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
                w2 = self.weight[part] ** 2
                value, slope, curve = LOSSES[self.loss](w2 * r * r)
                self._value += 0.5 * float(value.sum())
                self._gradient = self._gradient + J.T @ (w2 * slope * r)
                self._hessian = self._hessian + J.T @ (J * (w2 * curve)[:, None])
            self._at = x.copy()
        return self._value, self._gradient, self._hessian


class _Part(ca.Callback):
    """One of the functions that Ipopt evaluates, with CasADi's names and shapes."""

    def __init__(self, name: str, inputs: list[Any], output: Any, evaluate: Callable[[np.ndarray], list[Any]]) -> None:
        super().__init__()
        self._inputs, self._outputs, self._evaluate = inputs, output, evaluate
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_sparsity_in(self, i: int) -> Any:
        return self._inputs[i]

    def get_sparsity_out(self, i: int) -> Any:
        return self._outputs[i]

    def eval(self, arguments: Any) -> list[Any]:
        return self._evaluate(np.array(arguments[0].nonzeros()))


class LeastSquares:
    """An objective handed to Ipopt; built once, solved as often as weights, losses and starts change."""

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
        self._unit = 1 / np.sqrt(np.diag(hessian))
        self._solver = self._build(n)

    def _build(self, n: int) -> ca.Function:
        dense, none, one = ca.Sparsity.dense(n, 1), ca.Sparsity(0, 1), ca.Sparsity.dense(1, 1)
        triangle = ca.Sparsity.upper(n)
        rows, columns = np.array(triangle.row()), np.array(triangle.get_col())

        def value(z: np.ndarray) -> list[Any]:
            return [self.objective.at(z * self._unit)[0]]

        def gradient(z: np.ndarray) -> list[Any]:
            f, g, _ = self.objective.at(z * self._unit)
            return [f, ca.DM(g * self._unit)]

        def hessian(z: np.ndarray) -> list[Any]:
            H = self.objective.at(z * self._unit)[2] * np.outer(self._unit, self._unit)
            return [ca.DM(triangle, H[rows, columns])]

        # CasADi keeps no reference of its own to Python callbacks
        self._parts = (
            _Part("nlp_f", [dense], [one], value),
            _Part("nlp_grad_f", [dense, none], [one, dense], gradient),
            _Part("nlp_hess_l", [dense, none, one, none], [triangle], hessian),
        )
        z = ca.MX.sym("z", n)
        options: dict[str, Any] = {
            "grad_f": self._parts[1],
            "hess_lag": self._parts[2],
            "print_time": False,
            "error_on_fail": False,
            "no_nlp_grad": True,
            "ipopt": {
                "print_level": 0, "sb": "yes", "max_iter": ITERATIONS, "tol": 1e-4, "dual_inf_tol": 1e-4,
                # the extent of an upright flat wire end has a kink, at which steps shrink without end: see `_stalled`
                "acceptable_iter": 5, "acceptable_tol": 1e9, "acceptable_dual_inf_tol": 1e9,
                "acceptable_obj_change_tol": 1e-5, "watchdog_shortened_iter_trigger": 0,
                "nlp_scaling_method": "none", "linear_solver": "mumps", "mu_strategy": "adaptive",
            },
        }  # fmt: skip
        problem: dict[str, Any] = {"x": z, "f": self._parts[0](z)}
        return ca.nlpsol("least_squares", "ipopt", problem, options)

    def solve(self, start: Float[np.ndarray, " unknowns"]) -> Solution:
        """Minimise from a start."""
        import time

        begin = time.perf_counter()
        result = self._solver(x0=start / self._unit, lbx=self.lower / self._unit, ubx=self.upper / self._unit)
        seconds = time.perf_counter() - begin
        stats = self._solver.stats()
        x = np.array(result["x"]).ravel() * self._unit
        status = str(stats["return_status"])
        if status == "Solved_To_Acceptable_Level" and not self._stalled(x):
            status = "Stopped_Without_Progress"
        return Solution(x, int(stats["iter_count"]), status, seconds)

    def _stalled(self, x: Float[np.ndarray, " unknowns"]) -> bool:
        """Whether no part of the Newton step lowers the objective by more than chance would notice."""
        value, gradient, hessian = self.objective.at(x)
        step = -np.linalg.solve(hessian, gradient)
        return all(self.objective.at(x + share * step)[0] > value - UNNOTICED for share in (1.0, 0.3, 0.1, 0.03, 0.01))
