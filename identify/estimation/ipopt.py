"""Ipopt for so many unknowns, made once a size: a problem is lent to it for one solution.

Making a solver takes as long as two of its iterations. Objective, gradient and Hessian are asked of the problem that it
has at the time, in CasADi's own memory.
"""

import io
import re
from collections import defaultdict
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

ITERATIONS = 200  # of Ipopt; a calibration takes 3 to 30
OPTIONS = {
    "print_level": 0,
    "sb": "yes",
    # the extent of an upright flat wire end has a kink, at which steps shrink without end: `LeastSquares` looks
    # whether that is so
    "acceptable_iter": 5,
    "acceptable_tol": 1e9,
    "acceptable_dual_inf_tol": 1e9,
    "acceptable_obj_change_tol": 1e-5,
    "watchdog_shortened_iter_trigger": 0,
    "nlp_scaling_method": "none",
    "linear_solver": "mumps",
    "mu_strategy": "adaptive",
}
Values = Callable[[np.ndarray], tuple[float, np.ndarray, np.ndarray]]
_idle: dict[tuple[int, float, int], list["Program"]] = defaultdict(list)


def minimize(
    at: Values,
    basis: Float[np.ndarray, "n n"],
    start: Float[np.ndarray, " n"],
    lower: Float[np.ndarray, " n"],
    upper: Float[np.ndarray, " n"],
    tolerance: float,
) -> tuple[Float[np.ndarray, " n"], dict[str, Any]]:
    """The minimum of what `at` gives value, gradient and Hessian of, between bounds; and Ipopt's statistics.

    Ipopt sees the coordinates z of x = basis z, and stops where no element of the gradient by them exceeds the
    tolerance. The basis is upper triangular; diagonal, where there are bounds.
    """
    key = len(start), tolerance, ITERATIONS
    idle = _idle[key]
    program = idle.pop() if idle else Program(*key)
    try:
        return program.minimize(at, basis, start, lower, upper)
    finally:
        idle.append(program)


class Program:
    """An NLP of so many unknowns whose functions are those of the problem that it has."""

    def __init__(self, n: int, tolerance: float, iterations: int) -> None:
        dense, none, one = ca.Sparsity.dense(n, 1), ca.Sparsity(0, 1), ca.Sparsity.dense(1, 1)
        triangle = ca.Sparsity.upper(n)
        self._at: Values | None = None
        self._basis = np.eye(n)
        self._places = np.array(triangle.row()), np.array(triangle.get_col())
        # CasADi keeps no reference of its own to Python callbacks
        self._parts = (
            _Part("nlp_f", [dense], [one], self._value),
            _Part("nlp_grad_f", [dense, none], [one, dense], self._gradient),
            _Part("nlp_hess_l", [dense, none, one, none], [triangle], self._hessian),
        )
        z = ca.MX.sym("z", n)
        options: dict[str, Any] = {
            "grad_f": self._parts[1],
            "hess_lag": self._parts[2],
            "print_time": False,
            "error_on_fail": False,
            "no_nlp_grad": True,
            "ipopt": {**OPTIONS, "tol": tolerance, "dual_inf_tol": tolerance, "max_iter": iterations},
        }
        problem: dict[str, Any] = {"x": z, "f": self._parts[0](z)}
        self._solver = ca.nlpsol("least_squares", "ipopt", problem, options)

    def minimize(
        self, at: Values, basis: np.ndarray, start: np.ndarray, lower: np.ndarray, upper: np.ndarray
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """The minimum, and Ipopt's statistics."""
        self._at, self._basis, unit = at, basis, np.diag(basis)
        try:
            solution = self._solver(x0=np.linalg.solve(basis, start), lbx=lower / unit, ubx=upper / unit)
        finally:
            self._at = None
        return basis @ np.array(solution["x"]).ravel(), self._solver.stats()

    def _there(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        assert self._at is not None
        return self._at(self._basis @ z)

    def _value(self, z: np.ndarray) -> list[Any]:
        return [self._there(z)[0]]

    def _gradient(self, z: np.ndarray) -> list[Any]:
        value, gradient, _ = self._there(z)
        return [value, gradient @ self._basis]

    def _hessian(self, z: np.ndarray) -> list[Any]:
        return [(self._basis.T @ self._there(z)[2] @ self._basis)[self._places]]


class _Part(ca.Callback):
    """One of the functions that Ipopt evaluates, with CasADi's names and shapes."""

    def __init__(
        self, name: str, inputs: list[Any], outputs: list[Any], evaluate: Callable[[np.ndarray], list[Any]]
    ) -> None:
        super().__init__()
        self._inputs, self._outputs, self._evaluate = inputs, outputs, evaluate
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_sparsity_in(self, i: int) -> Any:
        return self._inputs[i]

    def get_sparsity_out(self, i: int) -> Any:
        return self._outputs[i]

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arguments: Any, results: Any) -> int:
        values = self._evaluate(np.frombuffer(arguments[0]))
        for result, value in zip(results, values, strict=True):
            if result is not None:  # it was not asked for
                np.frombuffer(result)[:] = value
        return 0


def ipopt_version() -> str:
    """The version of Ipopt, which says it itself when it solves a problem."""
    x, out = ca.SX.sym("x"), io.StringIO()
    with redirect_stdout(out):
        ca.nlpsol("version", "ipopt", {"x": x, "f": x * x}, {"ipopt.max_iter": 0})()
    match = re.search(r"Ipopt version (\d+(\.\d+)*)", out.getvalue())
    return match[1] if match else "unknown"
