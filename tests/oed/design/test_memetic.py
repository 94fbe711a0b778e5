"""The search over sets: nothing that single swaps improve, and nothing good lost."""

import numpy as np
import pytest
from small_designs import best_of, exchanged, problem, worth

from oed import exact_design
from oed.criteria.criteria import CRITERIA
from oed.design.exact import swaps_of


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


def test_a_search_that_begins_with_a_good_set_does_not_lose_it(rng):
    rows = rng.standard_normal((2000, 15))
    thorough, hasty = (exact_design(rows, 25, iterations=many, rng=np.random.default_rng(1)) for many in (200, 1))

    again = exact_design(rows, 25, iterations=1, start=thorough.indices, rng=np.random.default_rng(1))

    assert hasty.value < thorough.value
    assert again.value == pytest.approx(thorough.value)
