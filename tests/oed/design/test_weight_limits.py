"""Admissible weights: the best of them, and those under caps and quotas, against other solvers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from oed.design.weight_limits import admissible

SEEDS = st.integers(0, 2**32 - 1)


@given(seed=SEEDS)
def test_the_best_admissible_weights_are_those_of_a_linear_program(seed):
    rng = np.random.default_rng(seed)
    gain, cap, face = rng.normal(size=14), rng.uniform(0.1, 0.6, 14), rng.integers(0, 3, 14)
    face[:3] = [0, 1, 2]
    quotas = {0: (0.1, 0.4), 2: (0.0, 0.5)}
    if not feasible(cap, face, quotas):
        return

    total, _ = admissible(14, cap, face, quotas).best(gain)

    groups = np.array([face == 0, face == 0, face == 2])
    A, b = np.vstack([[-1], [1], [1]]) * groups, [-0.1, 0.4, 0.5]
    found = linprog(-gain, A_ub=A, b_ub=b, A_eq=np.ones((1, 14)), b_eq=[1], bounds=[(0, c) for c in cap])
    assert found.success
    assert total == pytest.approx(-found.fun, abs=2e-5)  # limits are widened by 1e-6
    assert total >= -found.fun - 1e-12


def feasible(cap, face, quotas):
    room = [min(cap[face == f].sum(), quotas.get(f, (0, 1))[1]) for f in range(3)]
    return sum(room) >= 1 and cap[face == 0].sum() >= 0.1
