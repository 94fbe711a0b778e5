"""A chain may be cut anywhere along and about its axes, and turned to other axes: the flange stays where it is."""

import numpy as np
import pytest
from exported import ROBOTS, cell_of, draws
from hypothesis import given
from hypothesis import strategies as st
from oracle import forward as oracle

from identify.export.chain import forward, origins, segments, slack_of, turn_to
from identify.model.frames import transform
from identify.model.io.description import library, read_robot


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_the_turn_takes_z_to_the_axis_and_is_a_rotation(v):
    axis = np.array(v) / np.linalg.norm(v)

    R = turn_to(axis)[:3, :3]

    np.testing.assert_allclose(R[:, 2], axis, atol=1e-6)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_the_turn_to_the_opposite_axis_is_half_a_turn():
    np.testing.assert_allclose(turn_to(np.array([0.0, 0.0, -1.0])), np.diag([1.0, -1.0, -1.0, 1.0]))


@pytest.mark.parametrize("name", ROBOTS)
def test_the_segments_carry_the_forward_kinematics(name, rng):
    robot = read_robot(library("robots")[name])
    cell = cell_of(robot)
    theta = cell.theta + 0.01 * rng.standard_normal(len(cell.theta))
    bare = theta.copy()
    bare[:6], bare[-6:] = 0.0, 0.0

    q = draws(robot, rng, 5)
    T = forward(origins(segments(robot, theta)), robot.prismatic, q)

    np.testing.assert_allclose(T, [oracle(robot, values, bare) for values in q], atol=1e-9)


def test_slack_along_and_about_an_axis_moves_no_flange_and_is_found_again(arc_welder, rng):
    robot = arc_welder.robot
    chain, turns = segments(robot, arc_welder.theta), [np.eye(4)] * len(robot.joints)
    slack = [transform(np.array([0, 0, d, a, 0, 0])) for d, a in rng.uniform(-2, 2, (len(turns), 2))]
    q = draws(robot, rng, 5)

    moved = origins(chain, slack, turns)

    np.testing.assert_allclose(
        forward(moved, robot.prismatic, q), forward(origins(chain), robot.prismatic, q), atol=1e-9
    )
    np.testing.assert_allclose(slack_of(chain, moved[:-1], turns), slack, atol=1e-9)
