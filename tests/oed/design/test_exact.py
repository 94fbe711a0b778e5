"""Exact designs: enumerated optima, the rules that a choice has to keep, and swaps that tell the truth."""

from itertools import combinations, combinations_with_replacement

import numpy as np
import pytest
from designed import refined, scattered
from hypothesis import given, settings
from hypothesis import strategies as st

from oed import approximate_design, exact_design
from oed.criteria.criteria import CRITERIA, score
from oed.design.exact import exchanged, swaps_of

SEEDS = st.integers(0, 2**32 - 1)


def problem(seed, candidates=12, parameters=3, poses=4):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(candidates, parameters)), rng.normal(size=(poses, 3, parameters)), rng


def worth(name, rows, chosen, zone=None, prior=0):
    X = rows[list(chosen)]
    return CRITERIA[name].on(zone, X.shape[1]).phi(X.T @ X + prior)


def best_of(name, rows, sets, zone=None, prior=0):
    """The largest worth of any of the sets."""
    return max(worth(name, rows, chosen, zone, prior) for chosen in sets)


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


def test_quotas_call_faces_by_name():
    rows, _, _ = problem(7)
    face = np.array(["top", "side"])[np.arange(12) % 2]

    design = exact_design(rows, 6, face=face, quotas={"top": (5, 6)})

    assert np.sum(face[design.indices] == "top") >= 5


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


@pytest.mark.parametrize("name", CRITERIA)
def test_no_swap_with_any_candidate_improves_a_design(name):
    rows, zone, _ = problem(15, candidates=40, parameters=4)

    design = exact_design(rows, 8, name, zone=zone)

    chosen = design.indices.tolist()
    reached = worth(name, rows, chosen, zone)
    others = sorted(set(range(40)) - set(chosen))
    swapped = [[*chosen[:a], j, *chosen[a + 1 :]] for a in range(8) for j in others]
    assert best_of(name, rows, swapped, zone) <= reached * (1 + 1e-6)


def test_what_is_begun_is_completed_with_what_adds_most():
    rows, _, _ = problem(18, candidates=30)
    swaps = swaps_of(CRITERIA["D"], rows, 1e-3 * np.eye(3))

    done = exchanged(swaps, 6, np.array([3, 4]))

    best = best_of("D", rows, [[*done[:a], j, *done[a + 1 :]] for a in range(6) for j in set(range(30)) - {*done}])
    assert worth("D", rows, done) >= best * (1 - 1e-6)


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": np.full((12, 3), np.nan)}, "rows: 12 of 12 rows are not finite, the first is row 0"),
        ({"n": 2}, "n: 2 touches beside what is known determine at most 2 of 3 parameters; ask for 1 more"),
        ({"n": 13}, "n: 13 touches to choose and only 12 candidates left; add candidates, or allow repeats"),
        ({"n": None}, "n: give a number of touches, or both `cost` and `budget`"),
        ({"criterion": "F"}, "criterion 'F' is unknown; choose one of"),
        ({"criterion": "G"}, "criterion 'G' scores the weld zone; give `zone`"),
        ({"quotas": {0: (1, 2)}}, "quotas: they need `face`, the face of each of the 12 candidates"),
        ({"quotas": {0: (3, 6), 1: (3, 6)}, "face": np.arange(12) % 2}, "quotas: the faces need 6 touches"),
        ({"quotas": {3: (1, 2)}, "face": np.arange(12) % 2}, "quota of face 3: no candidate lies on it"),
        ({"quotas": {0: (3, 1)}, "face": np.arange(12) % 2}, "quota of face 0: it takes 1 more touches and needs 3"),
        ({"quotas": {0: (4, 5)}, "face": np.arange(12) // 3}, "quota of face 0: it has 3 candidates and needs 4"),
        ({"fixed": np.array([12])}, r"fixed: index 12 is outside 0 ... 11"),
        ({"fixed": np.arange(5)}, "n: 5 touches of which 5 are fixed leave none to choose"),
        ({"min_distance": 1.0}, "min_distance: it needs `positions`"),
        ({"min_distance": 9.0, "positions": np.eye(12, 3)}, "rules: found no set of 5 touches"),
        ({"cost": -np.ones(12), "budget": 3.0}, "cost: expected one positive number for each of the 12 candidates"),
        ({"cost": np.ones(12), "budget": 0.5, "n": None}, "budget: 0.5 is left, and the cheapest touch costs 1"),
        ({"seconds": -1.0}, "seconds: -1, expected more than 0"),
        ({"n": 5.5}, "n: 5.5, expected a whole number of touches"),
        ({"iterations": 0}, "iterations: 0, expected at least 1"),
        ({"relaxation": approximate_design(np.eye(3))}, "relaxation: of 3 candidates and criterion 'D', expected 12"),
    ],
)
def test_a_question_without_an_answer_gets_one_sentence(change, message):
    with pytest.raises(ValueError, match=message):
        exact_design(**{"rows": problem(16)[0], "n": 5, **change})


def test_a_search_that_begins_with_a_good_set_does_not_lose_it(rng):
    rows = rng.standard_normal((2000, 15))
    thorough, hasty = (exact_design(rows, 25, iterations=many, rng=np.random.default_rng(1)) for many in (200, 1))

    again = exact_design(rows, 25, iterations=1, start=thorough.indices, rng=np.random.default_rng(1))

    assert hasty.value < thorough.value
    assert again.value == pytest.approx(thorough.value)
