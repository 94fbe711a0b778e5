"""Swaps tell the truth: what a table promises is what recomputing finds, for every criterion."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oed.criteria.criteria import CRITERIA
from oed.design.constraints import Rules
from oed.design.exact import swaps_of

SEEDS = st.integers(0, 2**32 - 1)


def problem(seed, candidates=14, parameters=4, poses=4):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(candidates, parameters)), rng.normal(size=(poses, 3, parameters)), rng


@pytest.mark.parametrize("name", CRITERIA)
@settings(max_examples=25)
@given(seed=SEEDS)
def test_what_a_swap_promises_is_what_recomputing_finds(name, seed):
    rows, zone, rng = problem(seed, candidates=14, parameters=4)
    swaps = swaps_of(CRITERIA[name].on(zone, 4), rows, 1e-6 * np.eye(4))
    members = rng.choice(14, 7, replace=False)
    swaps.load(members)

    for _ in range(4):  # what low-rank updates leave is as true as what was computed anew
        table = swaps.table()
        Rules(size=14).forbid(table, swaps.members)
        before = swaps.log(swaps.members)
        a, j, ratio = swaps.best(table)
        after = swaps.members.copy()
        after[a] = j
        swaps.swap(a, j)

        assert np.log(ratio) == pytest.approx(swaps.log(after) - before, abs=2e-4)  # single precision
        assert swaps.members.tolist() == after.tolist()


@pytest.mark.parametrize("name", ["D", "A", "V"])
@settings(max_examples=25)
@given(seed=SEEDS)
def test_every_entry_of_a_table_is_what_recomputing_finds(name, seed):
    rows, zone, rng = problem(seed, candidates=14, parameters=4)
    swaps = swaps_of(CRITERIA[name].on(zone, 4), rows, 1e-6 * np.eye(4))
    swaps.load(rng.choice(14, 9, replace=False))
    for _ in range(3):
        swaps.swap(int(rng.integers(9)), int(rng.choice(np.setdiff1d(np.arange(14), swaps.members))))

    table, before = swaps.table(), swaps.log(swaps.members)

    for a in range(9):
        for j in np.setdiff1d(np.arange(14), swaps.members):
            after = swaps.members.copy()
            after[a] = j
            gain = np.exp(swaps.log(after) - before)
            found = max(table[a, j], 0) ** (1 / 4) if name == "D" else 1 / (1 - table[a, j])
            assert found == pytest.approx(gain, rel=5e-3, abs=1e-3)
