"""Sets of measurements of several rows and of different costs: no worse than all others of small problems."""

from itertools import combinations

import numpy as np
import pytest
from several_rows import OWNER, P

from oed.design.budget import budget_design

COST = np.where(np.bincount(OWNER) == 3, 2.5, 1.0)


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
