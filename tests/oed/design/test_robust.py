"""Swaps for several robots at once: the mean of their criteria, for every criterion."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_designs import exchanged

from oed.criteria.criteria import CRITERIA
from oed.design.constraints import Rules
from oed.design.exact import swaps_of
from oed.design.robust import RobustSwaps

SEEDS = st.integers(0, 2**32 - 1)


def problem(seed, candidates=14, parameters=4, poses=4):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(candidates, parameters)), rng.normal(size=(poses, 3, parameters)), rng


@pytest.mark.parametrize("name", CRITERIA)
@settings(max_examples=10)
@given(seed=SEEDS)
def test_a_swap_promises_the_mean_of_several_robots_some_of_which_miss_a_touch(name, seed):
    rows, zone, rng = problem(seed)
    missing = np.where(rng.random((14, 1)) < 0.3, 0.0, rows)
    several = [rows, missing, rows + 0.3 * rng.normal(size=rows.shape)]
    precisions = np.float32, np.float64, np.float32  # double where a robot may meet fewer touches than parameters
    criterion, known = CRITERIA[name].on(zone, 4), 1e-6 * np.eye(4)
    swaps = RobustSwaps(
        [swaps_of(criterion, X, known, None, precision) for X, precision in zip(several, precisions, strict=True)]
    )
    swaps.load(rng.choice(14, 8, replace=False))

    def judged(chosen):
        logs = [criterion.log(X[chosen].T @ X[chosen] + known) for X in several]
        return np.mean(logs)

    for _ in range(3):
        table = swaps.table()
        Rules(size=14).forbid(table, swaps.members)
        a, j, ratio = swaps.best(table)
        after = swaps.members.copy()
        after[a] = j
        promised, before = np.log(ratio), judged(swaps.members)
        swaps.swap(a, j)

        assert promised == pytest.approx(judged(after) - before, abs=2e-4)  # single precision


def test_what_is_exchanged_for_several_robots_suits_them_at_least_as_well_as_what_suits_one():
    rows, _, rng = problem(17, candidates=80, parameters=4)
    several = [rows, *(rows + 0.5 * rng.normal(size=(3, *rows.shape)))]
    known = 1e-3 * np.eye(4)
    robots = [swaps_of(CRITERIA["D"], X, known) for X in several]

    alone = exchanged(robots[0], 8)
    robust = RobustSwaps(robots)
    together = exchanged(robust, 8, alone)

    assert len(set(together.tolist())) == 8
    assert robust.log(together) > robust.log(alone)
    assert robots[0].log(together) <= robots[0].log(alone)
