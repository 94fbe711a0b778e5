"""Rules that a choice keeps, and the best sets among those that keep them."""

from itertools import combinations, combinations_with_replacement

import numpy as np
import pytest
from small_designs import best_of, problem, worth

from oed import exact_design


@pytest.mark.parametrize("name", ["D", "V", "E"])
def test_quotas_and_fixed_touches_get_the_optimum_among_the_sets_that_keep_them(name):
    rows, zone, _ = problem(7)
    face = np.arange(12) % 3

    design = exact_design(rows, 6, name, zone=zone, fixed=np.array([4, 5]), face=face, quotas={0: (2, 4), 2: (1, 1)})

    sets = [
        chosen
        for chosen in combinations(range(12), 6)
        if {4, 5} <= set(chosen) and 2 <= np.sum(face[list(chosen)] == 0) <= 4 and np.sum(face[list(chosen)] == 2) == 1
    ]
    best = best_of(name, rows, sets, zone)
    assert design.indices[:2].tolist() == [4, 5]
    assert sorted(design.indices.tolist()) in [list(chosen) for chosen in sets]
    assert worth(name, rows, design.indices, zone) == pytest.approx(best, rel=1e-9)
    assert best <= worth(name, rows, design.indices, zone) / design.efficiency * (1 + 1e-9)


@pytest.mark.parametrize("name", ["D", "A", "G"])
def test_touches_keep_their_distance_and_are_the_best_that_do(name):
    rows, zone, rng = problem(8)
    positions = rng.uniform(size=(12, 2))
    apart = np.linalg.norm(positions[:, None] - positions, axis=2)

    design = exact_design(rows, 4, name, zone=zone, positions=positions, min_distance=0.35)

    sets = [c for c in combinations(range(12), 4) if min(apart[i, j] for i, j in combinations(c, 2)) >= 0.35]
    assert tuple(sorted(design.indices.tolist())) in sets
    assert worth(name, rows, design.indices, zone) == pytest.approx(best_of(name, rows, sets, zone), rel=1e-9)


def test_a_fixed_touch_keeps_others_away_too():
    rows, _, _ = problem(9)
    positions = np.arange(12.0)[:, None]

    design = exact_design(rows, 4, fixed=np.array([5]), positions=positions, min_distance=2.5)

    assert np.diff(np.sort(positions[design.indices, 0])).min() >= 2.5
    assert design.indices[0] == 5


def test_a_budget_of_time_buys_what_enumeration_finds():
    rows, _, rng = problem(10, candidates=10)
    cost = rng.uniform(1, 3, 10)

    design = exact_design(rows, cost=cost, budget=8.0)

    sets = [c for m in range(3, 9) for c in combinations(range(10), m) if cost[list(c)].sum() <= 8]
    assert cost[design.indices].sum() <= 8
    assert worth("D", rows, design.indices) == pytest.approx(best_of("D", rows, sets), rel=1e-9)
    assert design.efficiency <= 1 + 1e-9


def test_repeats_are_allowed_where_they_are_asked_for():
    rows, _, _ = problem(11, candidates=6)

    design = exact_design(rows, 7, repeats=True)

    best = best_of("D", rows, combinations_with_replacement(range(6), 7))
    assert worth("D", rows, design.indices) == pytest.approx(best, rel=1e-9)
