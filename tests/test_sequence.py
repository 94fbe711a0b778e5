"""The order of touches: short, complete, around what is in the way."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identify.model.touch import Plan
from oed.sequence import order, shortest, travel


def shortest_by_dynamic_programming(D):
    """Length of the shortest open path through all places, exactly (Bellman 1962; Held and Karp 1962)."""
    n = len(D)
    cost = {(1 << i, i): 0.0 for i in range(n)}
    for done in range(1, 1 << n):
        for last in range(n):
            if (done, last) in cost:
                for to in (k for k in range(n) if not done >> k & 1):
                    new = (done | 1 << to, to)
                    cost[new] = min(cost.get(new, np.inf), cost[done, last] + D[last, to])
    return min(cost[(1 << n) - 1, last] for last in range(n))


def length(D, path):
    return sum(D[a, b] for a, b in pairwise(path))


@pytest.mark.parametrize("seed", range(8))
def test_ten_places_are_visited_within_two_percent_of_the_shortest_path(seed):
    places = np.random.default_rng(seed).random((10, 6))
    D = np.abs(places[:, None] - places[None]).max(axis=2)

    path = shortest(D, np.random.default_rng(0))

    assert length(D, path) <= 1.02 * shortest_by_dynamic_programming(D)


@given(n=st.integers(1, 15), seed=st.integers(0, 1000))
def test_every_place_is_visited_once_and_the_path_is_never_longer_than_before(n, seed):
    rng = np.random.default_rng(seed)
    places = rng.random((n, 3))
    D = np.linalg.norm(places[:, None] - places[None], axis=2)
    before = rng.permutation(n)

    path = shortest(D, rng, before)

    assert sorted(path) == list(range(n))
    assert length(D, path) <= length(D, before) + 1e-9


def plan_of(approach):
    n = len(approach)
    return Plan(tuple(map(str, range(n))), ("top-high",) * n, np.zeros((n, 3)), np.zeros((n, 3)), approach, approach)


def test_the_slowest_joint_sets_the_time(arc_welder):
    q = np.zeros((2, 6))
    q[1] = np.radians([11, 11, 0, 0, 0, 48])  # at 110, 110 and 240 degrees a second

    assert travel(arc_welder, q)[0, 1] == pytest.approx(0.2)


def test_ways_that_are_not_clear_are_avoided(arc_welder, rng):
    """Touches left and right of a wall with one door, between touches 0 and 1."""
    approach = rng.uniform(-0.5, 0.5, (12, 6))
    side = np.arange(12) % 2
    approach[:, 0] = np.where(side, 0.4, -0.4)

    clear = side[:, None] == side
    clear[0, 1] = clear[1, 0] = True

    found = order(arc_welder, plan_of(approach), clear)

    crossings = [set(pair) for pair in pairwise(found.index.tolist()) if side[pair[0]] != side[pair[1]]]
    assert crossings == [{0, 1}]
    assert found.blocked == ()


def test_a_way_that_cannot_be_avoided_is_named(arc_welder, rng):
    found = order(arc_welder, plan_of(rng.uniform(-0.5, 0.5, (5, 6))), np.zeros((5, 5), bool))

    assert found.blocked == (0, 1, 2, 3)


def test_the_minutes_count_travel_search_retract_and_the_wait(arc_welder):
    approach = np.zeros((2, 6))
    approach[1, 5] = np.radians(120)  # half a second at 240 degrees a second; the tip lies on the axis and stays

    found = order(arc_welder, plan_of(approach))

    assert 60 * found.minutes == pytest.approx(0.5 + 2 * (25 / 5 + 25 / 100 + 0.4))
