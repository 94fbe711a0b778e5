"""All touches moved at once: derivatives in closed form, and what the move gains."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from oed.refinement.coordinate import refine
from oed.refinement.simultaneous import Simultaneous


def test_gradient_and_hessian_of_all_touches_are_those_of_finite_differences(offered, refinement, rng):
    three, coordinates = offered.candidates.take(np.array([0, 10, 20])), refinement.coordinates
    root = rng.standard_normal((5, len(coordinates)))
    W = root.T @ root
    program = Simultaneous(refinement.program, W, 3)
    at = refinement.program.numbers(three)
    x, p = at.x.ravel() + 1e-3, at.p.ravel()
    lam = 0.1 * rng.standard_normal(at.g_limits.shape[1] * at.g_limits.shape[2])
    unknowns, _ = program.symbols
    slope_of_g = ca.Function("g", program.symbols, [ca.jtimes(ca.vec(program.rows[2]), unknowns, ca.DM(lam), True)])

    def value(x):
        F = rows(x)
        return np.log(np.trace(W @ np.linalg.inv(coordinates.information(F))))

    def rows(x):
        q = x.reshape(3, -1)[:, : three.q.shape[1]]
        return coordinates.rows(replace(three, q=q).expected_rows(offered.cell))

    def slope(x):
        return np.array(program.gradient(x, p)[1] + slope_of_g(x, p)).ravel()

    H = np.array(program.hessian(x, p, 1.0, lam))

    step = 1e-6
    ways = step * np.eye(len(x))
    by_value = [(value(x + way) - value(x - way)) / (2 * step) for way in ways]
    by_slope = np.array([(slope(x + way) - slope(x - way)) / (2 * step) for way in ways])
    assert np.array(program.gradient(x, p)[1]).ravel() == pytest.approx(np.array(by_value), abs=1e-4)
    assert np.triu(by_slope) == pytest.approx(H, abs=3e-4 * np.abs(H).max())  # differences of the inverse lose digits


def test_moving_all_at_once_never_harms_where_moving_one_by_one_ends(refinement, information, criterion, chosen):
    alone, together = (refine(refinement, chosen, criterion, sweeps=2, together=flag) for flag in (False, True))

    assert criterion.log(information(together)) >= criterion.log(information(alone))
