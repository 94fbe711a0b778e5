"""Sets of measurements of several rows and of different costs: no worse than all others of small problems."""

from itertools import combinations

import numpy as np
import pytest

from oed.design.budget import budget_design
from oed.design.relaxation import approximate_design

P = 5
OWNER = np.repeat(np.arange(12), [1, 3, 1, 1, 3, 1, 1, 3, 1, 1, 3, 1])
COST = np.where(np.bincount(OWNER) == 3, 2.5, 1.0)


@pytest.fixture
def rows(rng):
    return rng.standard_normal((len(OWNER), P))


@pytest.fixture
def zone(rng):
    return rng.standard_normal((20, 3, P))


def information(rows, members):
    some = rows[np.isin(OWNER, members)]
    return np.eye(P) + some.T @ some


def every_set(budget):
    for n in range(1, 13):
        yield from (np.array(s) for s in combinations(range(12), n) if COST[list(s)].sum() <= budget)


@pytest.mark.parametrize("criterion", ["V", "D", "A"])
def test_no_set_that_fits_the_budget_is_better_and_none_beats_the_bound(rows, zone, criterion):
    design = budget_design(rows, OWNER, COST, 7.0, criterion, prior=np.eye(P), zone=zone)

    assert design.cost == pytest.approx(COST[design.members].sum())
    assert design.cost <= 7.0
    sign = 1 if criterion == "D" else -1
    M = np.stack([information(rows, s) for s in every_set(7.0)])
    if criterion == "D":
        values = np.linalg.det(M) ** (1 / P)
    else:
        J = zone if criterion == "V" else np.eye(P)[None]
        values = np.einsum("pik,nkl,pil->n", J, np.linalg.inv(M), J) / len(J)
    best = (sign * values).max()
    mine = (sign * values)[[set(s) == set(design.members) for s in every_set(7.0)].index(True)]
    assert mine == pytest.approx(best, rel=0.02)
    share = best / mine if criterion != "D" else mine / best  # 1 or a little less
    assert design.efficiency <= share + 1e-6


def test_a_weight_on_a_measurement_counts_for_all_its_rows(rows):
    design = approximate_design(rows, "D", 1e-5, owner=OWNER)

    each = rows * np.sqrt(design.weights)[OWNER][:, None]
    assert design.weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(each.T @ each, design.information, rtol=1e-6, atol=1e-9)
    gain = np.bincount(OWNER, np.einsum("ij,jk,ik->i", rows, np.linalg.inv(design.information), rows))
    assert gain.max() == pytest.approx(P, rel=1e-3)  # Kiefer and Wolfowitz: no measurement gains more than p


def test_measurements_of_one_row_are_weighed_as_before(rows):
    plain, owned = (approximate_design(rows, "D", owner=owner) for owner in (None, np.arange(len(rows))))

    np.testing.assert_array_equal(plain.weights, owned.weights)


def test_a_budget_for_everything_takes_everything(rows, zone):
    design = budget_design(rows, OWNER, COST, 100.0, prior=np.eye(P), zone=zone)

    assert len(design.members) == 12
    assert design.efficiency == 1


@pytest.mark.parametrize(
    ("cost", "budget", "owner", "words"),
    [
        (COST, 0.5, OWNER, "less than the cheapest"),
        (-COST, 5.0, OWNER, "one positive number"),
        (COST, 5.0, OWNER[::-1], "counting 0, 0, 1"),
    ],
)
def test_a_problem_that_cannot_be_solved_is_refused_in_words(rows, zone, cost, budget, owner, words):
    with pytest.raises(ValueError, match=words):
        budget_design(rows, owner, cost, budget, prior=np.eye(P), zone=zone)
