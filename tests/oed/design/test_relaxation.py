"""Approximate designs: known optima, other solvers, and a certificate that no enumerated set may beat."""

from itertools import combinations, combinations_with_replacement

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from weighted import CERTIFIED, KINKED, SMOOTH, small

from oed.criteria.criteria import CRITERIA, score
from oed.design.relaxation import approximate_design

SEEDS = st.integers(0, 2**32 - 1)
GRID = np.linspace(-1, 1, 41)
QUADRATIC = np.stack([np.ones_like(GRID), GRID, GRID**2], axis=1)


def best_of_all(rows, n, name, zone, prior, sets):
    """Largest phi of any of the sets."""
    M = np.array([rows[list(chosen)].T @ rows[list(chosen)] + prior for chosen in sets])
    value = score(name, M, 1, zone) ** (1 / CRITERIA[name].degree)
    return float(np.nanmax(value))


def blind(seed, candidates, unseen):
    """Touches at one place of a jig, the same at a second one of unknown pose; a zone that does not see the pose."""
    rows, zone, rng = small(seed, candidates, 12, 20)
    pose_rows = 200 * rng.normal(size=(candidates, unseen))
    both = np.block([[rows, np.zeros((candidates, unseen))], [rows, pose_rows]])
    return rows, both, zone, np.pad(zone, ((0, 0), (0, 0), (0, unseen)))


@settings(max_examples=20)
@given(seed=SEEDS)
def test_a_second_place_of_unknown_pose_that_shows_nothing_new_buys_nothing(seed):
    rows, both, zone, padded = blind(seed, 100, 6)

    alone = approximate_design(rows, "V", 1e-5, touches=50, prior=np.eye(12), zone=zone)
    second = approximate_design(both, "V", 1e-5, touches=50, prior=np.eye(18), zone=padded)

    assert second.gap <= 1e-5
    assert second.value == pytest.approx(alone.value, rel=2e-5)
    assert second.bound <= alone.value * (1 + 1e-9)


@pytest.mark.parametrize("name", ["D", "V"])
@pytest.mark.parametrize("lost", [0.3, 1.0])
def test_a_search_that_begins_with_weights_of_other_candidates_finds_the_same_bound(name, lost):
    rows, zone, _ = small(3, 3000, 9, 20)
    few = approximate_design(rows[:2000], name, 1e-4, zone=zone)
    start = np.concatenate([few.weights, np.zeros(1000)])
    start[np.flatnonzero(start > 1e-3)[: round(lost * (start > 1e-3).sum())]] = 0.0  # touches that are no longer there

    cold = approximate_design(rows, name, 1e-4, zone=zone)
    warm = approximate_design(rows, name, 1e-4, zone=zone, start=start)

    assert warm.gap <= 1e-4
    assert warm.level == pytest.approx(cold.level, rel=2e-4)


# c-optimal designs of quadratic regression (Elfving 1952; Chebyshev's polynomial where one extrapolates): some of them
# leave parameters undetermined that the one which is asked for does not need
@pytest.mark.parametrize(
    ("wanted", "variance", "weights"),
    [
        ([0, 1, 0], 1, [1 / 2, 0, 1 / 2]),
        ([1, 0, 0], 1, [0, 1, 0]),
        ([0, 0, 1], 4, [1 / 4, 1 / 2, 1 / 4]),
        ([1, 2, 4], 49, [1 / 7, 3 / 7, 3 / 7]),
    ],
)
@pytest.mark.parametrize("name", ["V", "G"])
def test_what_the_zone_does_not_need_may_stay_open(name, wanted, variance, weights):
    design = approximate_design(QUADRATIC, name, zone=np.array(wanted, float)[None, None])

    assert design.gap <= 1e-6
    assert design.value == pytest.approx(variance, rel=2e-6)
    assert design.bound <= variance * (1 + 1e-9)
    assert design.weights[[0, 20, 40]] == pytest.approx(weights, abs=2e-3)
    assert design.weights.sum() == pytest.approx(1)


def test_a_zone_that_sees_what_no_touch_does_is_told_so():
    rows = np.pad(QUADRATIC, ((0, 0), (0, 1)))

    with pytest.raises(ValueError, match=r"determine 3 of 4 parameters \(parameter 3 is in no row\)"):
        approximate_design(rows, "V", zone=np.ones((1, 3, 4)))


# known optima of quadratic regression on [-1, 1] (Pukelsheim 1993; Atkinson, Donev and Tobias 2007)
@pytest.mark.parametrize(
    ("name", "ends", "value"),
    [("D", 1 / 3, (4 / 27) ** (1 / 3)), ("A", 1 / 4, 8.0), ("E", 1 / 5, 1 / 5), ("O1", 1 / 3, (4 / 27) ** (1 / 6))],
)
def test_quadratic_regression_has_the_optimum_of_the_textbooks(name, ends, value):
    design = approximate_design(QUADRATIC, name)

    tolerance = 1e-3 if name in SMOOTH else 0.01
    assert design.value == pytest.approx(value, rel=1e-5 if name in SMOOTH else 5e-3)
    assert design.weights[[0, 20, 40]] == pytest.approx([ends, 1 - 2 * ends, ends], abs=tolerance)


def test_the_worst_variance_over_the_candidates_is_the_number_of_parameters():
    design = approximate_design(QUADRATIC, "G", zone=QUADRATIC[:, None, :])  # Kiefer and Wolfowitz 1960

    assert design.value == pytest.approx(3, rel=5e-3)
    assert design.bound <= 3 * (1 + 1e-9)


def test_the_mean_variance_over_the_interval_is_that_of_the_textbooks():
    moment = np.array([[1, 0, 1 / 3], [0, 1 / 3, 0], [1 / 3, 0, 1 / 5]])

    design = approximate_design(QUADRATIC, "V", zone=moment)

    assert design.weights[[0, 20, 40]] == pytest.approx([1 / 4, 1 / 2, 1 / 4], abs=1e-3)


@pytest.mark.parametrize("name", CERTIFIED)
@settings(max_examples=15)
@given(seed=SEEDS, unseen=st.integers(0, 2))
def test_no_set_without_repeats_beats_the_certificate(name, seed, unseen):
    rows, zone, _ = small(seed)
    zone[:, :, :unseen] = 0

    design = approximate_design(rows, name, zone=zone, touches=4, cap=1 / 4)

    best = best_of_all(rows, 4, name, zone, 0, combinations(range(9), 4))
    assert best <= design.level * (1 + 1e-9)


@pytest.mark.parametrize("name", CERTIFIED)
@settings(max_examples=15)
@given(seed=SEEDS, unseen=st.integers(0, 2))
def test_no_set_with_repeats_and_a_prior_beats_the_certificate(name, seed, unseen):
    rows, zone, rng = small(seed)
    zone[:, :, :unseen] = 0
    known = rng.normal(size=(2, 3))
    prior = known.T @ known

    design = approximate_design(rows, name, zone=zone, touches=3, prior=prior)

    best = best_of_all(rows, 3, name, zone, prior, combinations_with_replacement(range(9), 3))
    assert best <= design.level * (1 + 1e-9)


@given(seed=SEEDS)
def test_no_set_within_quotas_beats_the_certificate_of_the_quotas(seed):
    rows, _, _ = small(seed)
    face = np.repeat([3, 5, 8], 3)
    sets = [c for c in combinations(range(9), 4) if sum(face[list(c)] == 3) >= 2 and sum(face[list(c)] == 8) <= 1]

    design = approximate_design(rows, touches=4, cap=1 / 4, face=face, quotas={3: (0.5, 1), 8: (0, 0.25)})

    assert best_of_all(rows, 4, "D", None, 0, sets) <= design.level * (1 + 1e-9)
    assert design.level < approximate_design(rows, touches=4).level * (1 + 1e-9)


@pytest.mark.parametrize("name", KINKED)
def test_a_criterion_with_a_kink_comes_within_a_percent_of_its_bound(name):
    rows, zone, _ = small(3, candidates=3000, parameters=8, poses=40)

    design = approximate_design(rows, name, zone=zone)

    assert 0 <= design.gap <= 0.01


def test_rows_in_other_units_have_the_same_optimal_weights():
    rows, _, rng = small(6, candidates=200, parameters=5)
    T = rng.normal(size=(5, 5)) * 10.0 ** np.arange(-2, 3)

    plain, moved = approximate_design(rows), approximate_design(rows @ T)

    assert moved.weights == pytest.approx(plain.weights, abs=1e-4)
    assert moved.value / plain.value == pytest.approx(abs(np.linalg.det(T)) ** (2 / 5), rel=1e-5)


def test_a_criterion_without_a_concave_form_has_weights_and_no_bound():
    rows, _, _ = small(7, candidates=100)

    design = approximate_design(rows, "O2")

    assert np.isnan(design.bound)
    assert np.isnan(design.gap)
    assert design.weights.sum() == pytest.approx(1)


def test_the_racing_problem_has_its_known_bound(shared_data):
    rows = np.load(shared_data / "oed20k" / "candidates.npz")["rows"]

    free, capped = approximate_design(rows), approximate_design(rows, cap=1 / 150)

    assert free.gap <= 1e-6
    assert free.value <= 0.6013036017 * (1 + 1e-7)
    assert free.bound >= 0.6013036017 * (1 - 1e-7)
    assert capped.bound / free.bound <= 0.9942 + 1e-4  # the factor that the peers computed


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": np.array([[1.0, np.nan]])}, r"rows: 1 of 1 rows are not finite, the first is row 0"),
        ({"rows": np.zeros(4)}, r"rows: shape \(4,\), expected \(candidates, parameters\)"),
        ({"rows": np.ones((5, 2))}, r"rows: they determine 1 of 2 parameters"),
        ({"rows": np.eye(3)[:, :2] * [1, 0]}, r"determine 1 of 2 parameters \(parameter 1 is in no row\)"),
        ({"cap": 0.01}, r"cap: 41 candidates hold a weight of 0.41 together, expected 1; add candidates"),
        ({"prior": -np.eye(3)}, r"prior: eigenvalue -1 is negative"),
        ({"prior": np.eye(2)}, r"prior: shape \(2, 2\), expected finite numbers of shape \(3, 3\)"),
        ({"quotas": {0: (0, 1)}}, "quotas: they need `face`"),
        ({"quotas": {7: (0.5, 1)}, "face": np.zeros(41, int)}, "quota of face 7: no candidate lies on it"),
        ({"quotas": {0: (0, 0.5)}, "face": np.zeros(41, int)}, "expected a range around 1; loosen a quota"),
        ({"quotas": {0: (0.9, 0.5)}, "face": np.zeros(41, int)}, "expected 0 <= smallest <= largest"),
        ({"criterion": "V"}, "scores the weld zone"),
    ],
)
def test_a_question_that_makes_no_sense_gets_one_sentence(change, message):
    with pytest.raises(ValueError, match=message):
        approximate_design(**{"rows": QUADRATIC, **change})
