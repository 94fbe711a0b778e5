"""Weights within limits are those of a general solver."""

import numpy as np
import pytest
from scipy.optimize import minimize
from weighted import phi, small

from oed.design.relaxation import approximate_design


@pytest.mark.parametrize("name", ["D", "A", "V"])
def test_caps_and_quotas_give_what_a_general_solver_gives(name):
    rows, zone, _ = small(5, candidates=30, parameters=4, poses=6)
    face = np.arange(30) % 3

    design = approximate_design(rows, name, zone=zone, cap=0.1, face=face, quotas={0: (0.5, 1), 1: (0, 0.2)})

    limits = [
        {"type": "eq", "fun": lambda w: w.sum() - 1},
        {"type": "ineq", "fun": lambda w: w[face == 0].sum() - 0.5},
        {"type": "ineq", "fun": lambda w: 0.2 - w[face == 1].sum()},
    ]
    found = minimize(
        lambda w: -np.log(phi(name, (rows.T * w) @ rows, zone)),
        np.full(30, 1 / 30),
        bounds=[(0, 0.1)] * 30,
        constraints=limits,
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert found.success
    assert np.log(phi(name, design.information, zone)) == pytest.approx(-found.fun, abs=1e-5)
    assert design.weights.max() <= 0.1 * (1 + 1e-5)
    assert design.weights[face == 0].sum() >= 0.5 - 1e-5
    assert design.weights[face == 1].sum() <= 0.2 + 1e-5
