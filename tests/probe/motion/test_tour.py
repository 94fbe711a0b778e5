"""The order of touches: short, complete, around what is in the way."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identify.model.touch import Plan
from probe.motion.joint_path import Geometry
from probe.motion.roadmap import with_via
from probe.motion.settings import Settings
from probe.motion.tour import minutes, order, seconds, shortest, travel
from probe.virtual.motion import straight


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


def test_ways_that_are_not_clear_are_avoided(rng):
    """Touches left and right of a wall with one door, between touches 0 and 1."""
    places = rng.uniform(-0.5, 0.5, (12, 6))
    side = np.arange(12) % 2
    clear = side[:, None] == side
    clear[0, 1] = clear[1, 0] = True
    D = np.where(clear, np.abs(places[:, None] - places[None]).max(axis=2), np.inf)

    tour, blocked = order(D, rng)

    crossings = [set(pair) for pair in pairwise(tour.tolist()) if side[pair[0]] != side[pair[1]]]
    assert crossings == [{0, 1}]
    assert len(blocked) == 0


def test_a_way_that_cannot_be_avoided_is_named(rng):
    D = np.full((5, 5), np.inf)

    _, blocked = order(D, rng)

    assert blocked.tolist() == [0, 1, 2, 3]


@given(n=st.integers(1, 9), seed=st.integers(0, 1000))
def test_an_order_begins_near_to_where_the_robot_stands(n, seed):
    rng = np.random.default_rng(seed)
    places = np.sort(rng.random(n))  # on a line, and the robot stands at its end

    tour, _ = order(np.abs(places[:, None] - places), rng, first=1.0 - places)

    assert tour.tolist() == list(range(n))[::-1]


def test_a_motion_takes_as_long_as_the_virtual_controller_needs_for_it(arc_welder, rng):
    robot = arc_welder.robot
    start, end = rng.uniform(robot.lower, robot.upper, (2, 40, 6))
    end[20:] = start[20:] + 0.01 * (end[20:] - start[20:])  # too short to come to speed

    found = seconds(arc_welder, start, end, 500.0)

    geometry = Geometry(arc_welder, Settings())
    rates = [geometry.move_rate(a, b, 500.0) for a, b in zip(start, end, strict=True)]
    ends = [straight(robot, a, b, r, 0.0).end for a, b, r in zip(start, end, rates, strict=True)]
    np.testing.assert_allclose(found, ends, rtol=0.02)  # ways of the tip are measured with fewer chords


def test_the_minutes_count_travel_search_retract_and_the_wait(arc_welder):
    """Two touches of a second and a half each way, on an axis on which the tip does not move."""
    approach, contact = np.zeros((2, 2, 6))
    approach[:, 5], contact[:, 5] = np.radians([[240.0, 480.0], [600.0, 840.0]])
    plan = replace(plan_of(approach), q=contact)

    found = minutes(arc_welder, plan)

    travelling, there_and_back, waiting = 1.0 + 0.2, 2 * (1.5 + 0.2), 0.5
    assert 60 * found == pytest.approx(travelling + 2 * (there_and_back + waiting), abs=1e-3)  # [s]


def test_a_search_begins_near_to_where_a_contact_is_sure_to_be(arc_welder):
    """On an axis that moves the tip by 25 mm, searched at 5 mm/s: of these only 5 x 0.4 + 1.5 mm."""
    approach = np.zeros((1, 6))
    _, J = arc_welder.kinematics.tip_jacobian(approach, arc_welder.theta)
    turn = np.linalg.norm(J[0][:, arc_welder.robot.parameters.index("j1.theta")])
    contact = approach + np.array([25.0 / turn, 0, 0, 0, 0, 0])
    plan = replace(plan_of(approach), q=contact)

    saved = 60 * (minutes(arc_welder, plan) - minutes(arc_welder, plan, np.array([0.4])))

    assert saved == pytest.approx(21.5 / 5 - 21.5 / 100, abs=0.2)  # [s]; and the ramps of one motion more


def test_postures_on_the_way_take_their_time(arc_welder):
    approach = np.zeros((2, 6))
    straight_on = minutes(arc_welder, plan_of(approach))
    via = np.full((2, 1, 6), np.nan)
    via[1] = [[0, 0, 0, 0, 0, np.radians(240.0)]]

    there_and_back = minutes(arc_welder, with_via(plan_of(approach), via))

    assert 60 * (there_and_back - straight_on) == pytest.approx(2 * (1.0 + 0.2), abs=1e-3)  # [s]


def test_promised_minutes_follow_the_speeds_and_waits_of_the_settings(arc_welder):
    approach, contact = np.zeros((2, 2, 6))
    approach[:, 5], contact[:, 5] = np.radians([[240.0, 480.0], [600.0, 840.0]])
    plan = replace(plan_of(approach), q=contact)
    usual = minutes(arc_welder, plan)

    slower = minutes(arc_welder, plan, None, Settings(override=0.5))
    patient = minutes(arc_welder, plan, None, Settings(clears=1.4))

    searching = 2 * (1.5 + 0.2) / 60  # at its own speed, whatever the override
    waiting = 2 * 0.5 / 60
    assert slower - usual == pytest.approx(usual - searching - waiting)
    assert patient - usual == pytest.approx(2 / 60)
