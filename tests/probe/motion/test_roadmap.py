"""Edges between touches: clear by as much as the robot is uncertain, over lifted postures where they must."""

from itertools import pairwise

import numpy as np
import pytest
from gaps import gap

from oed.planning.candidate_set import plan_of
from probe.motion.clearance import Clearance
from probe.motion.edges import Edges
from probe.motion.roadmap import Roadmap, lifts, shortest_ways, with_via
from probe.motion.tour import RAMP, travel


def test_the_shortest_ways_are_those_of_dijkstra(rng):
    from scipy.sparse.csgraph import shortest_path

    T = rng.uniform(1, 10, (12, 12))
    T = np.where(rng.random((12, 12)) < 0.4, np.inf, T)
    T = np.minimum(T, T.T)

    found, then = shortest_ways(T.copy(), 0, 12)

    np.fill_diagonal(T, 0.0)
    np.testing.assert_allclose(found, shortest_path(np.where(np.isinf(T), 0, T), directed=False))
    for a, b in np.argwhere(np.isfinite(found)):
        way = [a]
        while way[-1] != b:
            way.append(then[way[-1], b])
        assert sum(T[i, j] for i, j in pairwise(way)) == pytest.approx(found[a, b])


def test_lifted_postures_stand_above_their_approaches_with_the_wire_as_it_was(arc_welder, touches):
    edges = Edges(Clearance(arc_welder, arc_welder.theta), keep=50.0)

    found = lifts(edges, touches.approach, touches.normal)

    there = ~np.isnan(found).any(axis=1)
    tip, R = arc_welder.kinematics.tip(touches.approach[there], arc_welder.theta)
    above, as_it_was = arc_welder.kinematics.tip(found[there], arc_welder.theta)
    assert there.sum() > len(touches) / 2
    assert (np.linalg.norm(above - tip, axis=1) > 49.0).all()
    np.testing.assert_allclose(as_it_was, R, atol=0.02)
    assert (gap(arc_welder, found[there]) > gap(arc_welder, touches.approach[there]) - 1e-3).all()


def test_a_robot_may_go_over_lifted_postures_where_no_straight_way_is_clear(arc_welder, touches, rng):
    edges = Edges(Clearance(arc_welder, arc_welder.theta), keep=20.0)
    up = lifts(edges, touches.approach, touches.normal)
    up, none = up[~np.isnan(up).any(axis=1)], np.empty((0, 6))
    straight, lifted = (Roadmap(edges, over, none) for over in (none, up))

    alone, _ = straight.order(plan_of(touches), rng)
    found, _ = lifted.order(plan_of(touches), rng)

    assert len(found.blocked) < len(alone.blocked) or found.minutes <= alone.minutes
    assert np.isfinite(found.via).any()
    plan = with_via(plan_of(touches).take(found.index), found.via)
    for i in range(1, len(plan)):
        if i - 1 not in found.blocked:
            way = np.vstack([plan.approach[i - 1], plan.way(i)])
            assert edges.clear(way[:-1], way[1:]).all()


def test_the_first_touch_is_led_to_from_where_the_robot_stands(arc_welder, touches, rng):
    edges = Edges(Clearance(arc_welder, arc_welder.theta))
    up = lifts(edges, touches.approach, touches.normal)
    home = np.zeros((1, 6))

    found, _ = Roadmap(edges, up[~np.isnan(up).any(axis=1)], home).order(plan_of(touches), rng)

    plan = with_via(plan_of(touches).take(found.index), found.via)
    way = np.vstack([home, plan.way(0)])
    assert edges.clear(way[:-1], way[1:]).all()
    legs = [travel(arc_welder, np.vstack(pair))[0, 1] + RAMP for pair in pairwise(way)]
    assert sum(legs) < 10.0  # [s]
