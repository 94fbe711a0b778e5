"""Ipopt on problems lent to it: minima that are known, whatever basis it sees them in."""

import re

import numpy as np
from scipy.optimize import lsq_linear, rosen, rosen_der, rosen_hess

from identify.estimation.ipopt import ipopt_version, minimize


def quadratic(A, b):
    """Half the squares of A x - b, with gradient and Hessian."""

    def at(x):
        r = A @ x - b
        return 0.5 * float(r @ r), A.T @ r, A.T @ A

    return at


def test_least_squares_between_bounds_is_that_of_scipy(rng):
    A, b = rng.standard_normal((8, 3)), 3 * rng.standard_normal(8)
    lower, upper = np.full(3, -0.3), np.full(3, 0.4)

    x, stats = minimize(quadratic(A, b), np.diag([1.0, 10.0, 0.1]), np.zeros(3), lower, upper, 1e-9)

    assert stats["success"]
    np.testing.assert_allclose(x, lsq_linear(A, b, (lower, upper)).x, atol=1e-6)


def test_the_basis_changes_the_way_and_not_the_minimum(rng):
    A, b, free = rng.standard_normal((8, 3)), rng.standard_normal(8), np.full(3, np.inf)
    basis = np.triu(rng.standard_normal((3, 3))) + 3 * np.eye(3)

    x, _ = minimize(quadratic(A, b), basis, np.ones(3), -free, free, 1e-9)

    np.testing.assert_allclose(x, np.linalg.lstsq(A, b, rcond=None)[0], atol=1e-7)


def test_a_curved_valley_is_followed_to_its_end():
    free = np.full(4, np.inf)

    x, _ = minimize(lambda x: (rosen(x), rosen_der(x), rosen_hess(x)), np.eye(4), np.full(4, 0.5), -free, free, 1e-9)

    np.testing.assert_allclose(x, np.ones(4), atol=1e-6)


def test_a_problem_that_fails_leaves_the_solver_to_the_next(rng):
    A, b, free = rng.standard_normal((8, 3)), rng.standard_normal(8), np.full(3, np.inf)

    def broken(x):
        raise ArithmeticError("no value here")

    _, stats = minimize(broken, np.eye(3), np.zeros(3), -free, free, 1e-9)
    assert not stats["success"]

    x, _ = minimize(quadratic(A, b), np.eye(3), np.zeros(3), -free, free, 1e-9)
    np.testing.assert_allclose(x, np.linalg.lstsq(A, b, rcond=None)[0], atol=1e-7)


def test_ipopt_tells_its_version():
    assert re.fullmatch(r"3\.\d+\.\d+", ipopt_version())
