"""Column generation: few rounds, and bounds that are met."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from weighted import SMOOTH, phi, small

from oed.design.relaxation import approximate_design

SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("name", ["V", "G"])
@given(seed=SEEDS)
def test_touches_that_see_only_what_the_zone_sees_need_not_see_more(name, seed):
    rows, zone, rng = small(seed, candidates=40, parameters=3)
    T = rng.normal(size=(5, 3)) * 10.0 ** np.arange(-2, 3)[:, None]  # five parameters that come in three sums

    design = approximate_design(rows @ T.T, name, 1e-4, zone=zone @ T.T)

    known = approximate_design(rows, name, 1e-4, zone=zone)
    assert design.level == pytest.approx(known.level, rel=3e-3 if name == "G" else 2e-4)
    M = (rows.T * design.weights) @ rows
    assert phi(name, M, zone) == pytest.approx(phi(name, known.information, zone), rel=3e-3)
    assert np.abs(T @ M @ T.T - design.information).max() <= 1e-9 * np.abs(design.information).max()


@pytest.mark.parametrize("cap", [None, 1 / 200])
def test_near_copies_of_candidates_cost_no_more_rounds(cap):
    rng = np.random.default_rng(9)
    few = rng.normal(size=(400, 12))
    copies = np.repeat(few, 50, axis=0) * (1 + 1e-3 * rng.normal(size=(20_000, 12)))

    design = approximate_design(copies, touches=200, cap=cap)

    assert design.gap <= 1e-6
    assert design.rounds <= 20  # 60 are not enough where copies come in together
    assert design.value == pytest.approx(approximate_design(few).value, rel=0.02)  # no cap keeps from the best


@pytest.mark.parametrize("name", SMOOTH)
def test_the_bound_is_met_to_the_gap(name):
    rows, zone, _ = small(3, candidates=3000, parameters=8, poses=40)

    design = approximate_design(rows, name, zone=zone, gap=1e-7)

    assert 0 <= design.gap <= 1e-7
    assert design.weights.sum() == pytest.approx(1)
    assert design.closeness.max() <= 1 + 1e-6
    assert design.closeness[design.weights > 1e-3].min() > 1 - 1e-3  # who carries weight is as good as the best
