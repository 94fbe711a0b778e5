"""Swaps ranked to first order: the ranks are true for small changes, and forbidden swaps are never computed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oed.criteria.criteria import CRITERIA
from oed.criteria.first_order_swaps import FEW, FirstOrderSwaps, promising
from oed.criteria.swaps import NEVER
from oed.design.exact import swaps_of


@given(st.integers(0, 2**31), st.integers(1, 8), st.integers(1, 30))
def test_the_promising_swaps_are_the_largest_of_the_table_without_those_forbidden(seed, touches, pool):
    rng = np.random.default_rng(seed)
    ranks = rng.permutation(touches * pool).reshape(touches, pool).astype(float)
    table = np.where(rng.random((touches, pool)) < 0.3, NEVER, ranks)

    a, j = promising(table)

    allowed = np.sort(table[table > NEVER])[::-1]
    assert sorted(table[a, j].tolist(), reverse=True) == allowed[: min(FEW, len(allowed))].tolist()


@pytest.mark.parametrize("name", ["E", "G"])
def test_a_swap_with_a_touch_that_is_hardly_different_gains_what_the_table_says(name, rng):
    rows, zone = rng.normal(size=(10, 4)), rng.normal(size=(4, 3, 4))
    twins = rows[:8] * (1 + 1e-3 * rng.normal(size=(8, 4)))
    swaps = swaps_of(CRITERIA[name].on(zone, 4), np.vstack([rows[:8], twins]), 1e-6 * np.eye(4))
    assert isinstance(swaps, FirstOrderSwaps)
    swaps.load(np.arange(8))

    table = swaps.table()

    X = swaps.low.astype(float)
    M = X[:8].T @ X[:8] + 1e-6 * np.eye(4)
    S = swaps.slope(M)  # of the blurred criterion: the table is its gradient along each change
    for a in range(8):
        change = np.outer(X[8 + a], X[8 + a]) - np.outer(X[a], X[a])
        assert table[a, 8 + a] == pytest.approx(np.trace(S @ change), rel=0.05, abs=2e-5)


def test_neighbourhoods_widen_once_and_begin_again(rng):
    swaps = swaps_of(CRITERIA["E"], rng.normal(size=(10, 3)), 1e-6 * np.eye(3))
    swaps.load(np.arange(5))

    wider = [swaps.look_wider() for _ in swaps.criterion.blurs]

    assert wider == [True] * (len(wider) - 1) + [False]
    assert swaps.blur == 0
