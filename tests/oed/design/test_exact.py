"""Exact designs: enumerated optima, the rules that a choice has to keep, and swaps that tell the truth."""

from itertools import combinations

import numpy as np
import pytest
from designed import refined, scattered
from hypothesis import given, settings
from hypothesis import strategies as st
from small_designs import best_of, problem, worth

from oed import approximate_design, exact_design
from oed.criteria.criteria import CRITERIA, score

SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("name", CRITERIA)
@pytest.mark.parametrize("seed", range(3))
def test_a_small_problem_gets_the_optimum_that_enumeration_finds(name, seed):
    rows, zone, _ = problem(seed)

    design = exact_design(rows, 5, name, zone=zone, rng=np.random.default_rng(seed))

    best = best_of(name, rows, combinations(range(12), 5), zone)
    assert worth(name, rows, design.indices, zone) == pytest.approx(best, rel=1e-9)
    assert design.value == pytest.approx(float(score(name, rows[design.indices].T @ rows[design.indices], 5, zone)))
    assert len(set(design.indices.tolist())) == 5


@pytest.mark.parametrize("name", [name for name, criterion in CRITERIA.items() if criterion.certified])
@settings(max_examples=4)
@given(seed=SEEDS)
def test_no_enumerated_set_is_more_efficient_than_the_bound_allows(name, seed):
    rows, zone, _ = problem(seed, candidates=9)

    design = exact_design(rows, 4, name, zone=zone, iterations=20)

    best = best_of(name, rows, combinations(range(9), 4), zone)
    level = worth(name, rows, design.indices, zone) / design.efficiency
    assert best <= level * (1 + 1e-9)
    assert 0 < design.efficiency <= 1 + 1e-9


def test_as_many_touches_as_candidates_are_all_of_them():
    rows, _, _ = problem(19)

    assert sorted(exact_design(rows, 12).indices.tolist()) == list(range(12))


@pytest.mark.parametrize("name", ["D", "V", "O5"])
def test_what_is_known_already_counts(name):
    rows, zone, rng = problem(12, parameters=4)
    known = rng.normal(size=(3, 4)) * 3

    design = exact_design(rows, 3, name, zone=zone, prior=known.T @ known)

    best = best_of(name, rows, combinations(range(12), 3), zone, known.T @ known)
    assert worth(name, rows, design.indices, zone, known.T @ known) == pytest.approx(best, rel=1e-9)


def test_the_same_seed_gives_the_same_design_and_a_relaxation_can_be_reused():
    rows, _, _ = problem(13, candidates=400, parameters=8)
    relaxation = approximate_design(rows)

    one, two = (exact_design(rows, 16, rng=np.random.default_rng(3), iterations=30) for _ in range(2))
    three = exact_design(rows, 16, rng=np.random.default_rng(3), relaxation=relaxation)

    assert one.indices.tolist() == two.indices.tolist()
    assert three.relaxation is relaxation
    assert 0.9 < three.efficiency <= 1


def test_rows_in_other_units_get_the_same_design():
    rows, _, rng = problem(14, candidates=300, parameters=6)
    T = rng.normal(size=(6, 6)) * 10.0 ** np.arange(-3, 3)

    plain, moved = exact_design(rows, 12), exact_design(rows @ T, 12)

    assert worth("D", rows, moved.indices) == pytest.approx(worth("D", rows, plain.indices), rel=1e-3)
    assert moved.efficiency == pytest.approx(plain.efficiency, rel=1e-3)


def test_the_racing_problem_is_solved_as_well_as_the_peers_do(shared_data):
    rows = np.load(shared_data / "oed20k" / "candidates.npz")["rows"]

    design = exact_design(rows, 100, iterations=60)

    X = rows[design.indices]
    efficiency = np.linalg.det(X.T @ X / 100) ** (1 / 27) / 0.6013036017
    assert efficiency > 0.988  # R's AlgDesign: 0.983; the benchmark asks for the full 0.990
    assert efficiency < design.efficiency <= 1  # without replicates no set can reach the bound of the README


def test_where_few_candidates_are_near_the_best_a_few_searches_find_more_than_the_peers_do(shared_data):
    rows = np.load(shared_data / "oed20k" / "candidates.npz")["rows"]

    some = exact_design(rows[np.random.default_rng(0).choice(len(rows), 500, replace=False)], 50)
    everything = exact_design(rows, 50)

    assert some.searches < 50 < 10 * some.searches < everything.searches
    assert some.efficiency > 0.955  # figaroh's Detmax on such a problem; the largest weights of a relaxation: 0.948
    assert everything.efficiency > 0.962


def test_structure_and_refinement_tell_more_than_three_times_as_many_random_candidates(arc_welder):
    gain = refined(arc_welder, 3_000, iterations=60) / scattered(arc_welder, 10_000, iterations=60) - 1

    assert gain >= 0.06
