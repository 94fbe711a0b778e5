"""The laws behind the bounds, for every criterion of the table; and a criterion of one's own, written here."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from informations import ALL, OWN, drawn
from small_designs import exchanged

from oed import approximate_design, exact_design
from oed.design.exact import swaps_of
from oed.design.robust import RobustSwaps

SEEDS = st.integers(0, 2**32 - 1)
CERTIFIED = [name for name, criterion in ALL.items() if criterion.certified]


@pytest.mark.parametrize("name", ALL)
@given(seed=SEEDS)
def test_phi_is_the_value_to_a_power_and_of_degree_one(name, seed):
    criterion, _, M, _, _ = drawn(name, seed)

    degree = criterion.degree or 1.0
    assert criterion.phi(M) ** degree == pytest.approx(float(criterion.value(M)), rel=1e-7)
    if criterion.degree:
        assert criterion.phi(3 * M) == pytest.approx(3 * criterion.phi(M), rel=1e-7)


@pytest.mark.parametrize("name", CERTIFIED)
@given(seed=SEEDS, share=st.floats(0.01, 0.99))
def test_a_certified_criterion_is_concave(name, seed, share):
    criterion, _, M, other, _ = drawn(name, seed)

    mixed = criterion.phi(share * M + (1 - share) * other)

    assert mixed >= (share * criterion.phi(M) + (1 - share) * criterion.phi(other)) * (1 - 1e-7)


@pytest.mark.parametrize("name", CERTIFIED)
@given(seed=SEEDS)
def test_a_supporting_matrix_bounds_the_criterion_everywhere(name, seed):
    criterion, _, M, other, _ = drawn(name, seed)

    for sharper in criterion.sharpened():
        S = sharper.support(M)
        assert criterion.phi(other) <= np.sum(S * other) * (1 + 1e-7)
        assert criterion.phi(M) <= np.sum(S * M) * (1 + 1e-7)


@pytest.mark.parametrize("name", [name for name in CERTIFIED if name not in ("O3", "E", "G")])
@given(seed=SEEDS)
def test_the_support_touches_where_the_criterion_has_no_kinks(name, seed):
    criterion, _, M, _, _ = drawn(name, seed)

    assert np.sum(criterion.support(M) * M) == pytest.approx(criterion.phi(M), rel=1e-6)


@pytest.mark.parametrize("name", CERTIFIED)
def test_slopes_and_curvatures_are_those_of_finite_differences(name):
    criterion, X, _, _, rng = drawn(name, 8)
    w, step = rng.uniform(0.1, 1, 7), 1e-4 * np.eye(7)

    def log(w):
        return criterion.smooth((X.T * w) @ X)

    M = (X.T * w) @ X
    slope = [(log(w + e) - log(w - e)) / 2e-4 for e in step]
    bend = [[(log(w + e + f) - log(w + e - f) - log(w - e + f) + log(w - e - f)) / 4e-8 for f in step] for e in step]
    assert np.einsum("ij,jk,ik->i", X, criterion.slope(M), X) == pytest.approx(np.array(slope), rel=1e-4, abs=1e-5)
    assert -criterion.curvature(M, X) == pytest.approx(np.array(bend), rel=2e-3, abs=1e-4)


@pytest.mark.parametrize("name", ALL)
@given(seed=SEEDS)
def test_in_another_basis_it_is_the_same_criterion(name, seed):
    criterion, X, M, _, rng = drawn(name, seed)
    T = rng.normal(size=(4, 4)) + 3 * np.eye(4)

    moved = criterion.in_basis(T)

    assert moved.log(T.T @ M @ T) == pytest.approx(criterion.log(M), abs=1e-6)
    sloped = (X @ T) @ moved.slope(T.T @ M @ T) @ (X @ T).T
    assert sloped == pytest.approx(X @ criterion.slope(M) @ X.T, rel=1e-3, abs=1e-4 * np.abs(sloped).max())


@pytest.mark.parametrize("name", CERTIFIED)
@settings(max_examples=10)
@given(seed=SEEDS)
def test_the_support_of_a_relaxation_is_its_bound_for_any_information(name, seed):
    criterion, X, M, other, rng = drawn(name, seed, rows=12)
    prior = rng.normal(size=(2, 4))
    prior = prior.T @ prior

    design = approximate_design(X, criterion, touches=5, prior=prior)

    gains = np.einsum("ij,jk,ik->i", X, design.support, X)
    assert design.level == pytest.approx(np.sum(design.support * prior) + 5 * gains.max(), rel=1e-6)
    for information in (M, other):
        assert criterion.phi(information) <= np.sum(design.support * information) * (1 + 1e-7)


def test_an_own_criterion_gets_relaxation_exchange_and_robust_choice():
    rng = np.random.default_rng(3)
    rows, known = rng.normal(size=(14, 3)), 1e-3 * np.eye(3)
    own = OWN.on(None, 3)

    design = exact_design(rows, 5, OWN, prior=known)

    phi = {chosen: own.phi(rows[list(chosen)].T @ rows[list(chosen)] + known) for chosen in combinations(range(14), 5)}
    best = max(phi, key=phi.__getitem__)
    assert tuple(sorted(design.indices.tolist())) == best
    assert phi[best] <= design.relaxation.level
    assert design.efficiency == pytest.approx(phi[best] / design.relaxation.level)
    several = [rows, rows + 0.5 * rng.normal(size=rows.shape)]
    robust = RobustSwaps([swaps_of(own, X, known) for X in several])
    together = exchanged(robust, 5, design.indices)
    assert robust.log(together) >= robust.log(np.array(best)) - 1e-9


def test_no_design_is_better_than_a_bound_that_is_not_its_own():
    rows = np.random.default_rng(5).normal(size=(60, 3))
    of_less = approximate_design(rows / 2, "D", touches=6)

    with pytest.raises(ValueError, match=r"D: a design is .* times as good as its bound"):
        exact_design(rows, 6, "D", relaxation=of_less)
