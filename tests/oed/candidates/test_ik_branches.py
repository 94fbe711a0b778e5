"""Solutions are told apart where they differ by more than whole turns, and those of neighbours are found again."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identify.model.io.description import library, read_cell
from oed.candidates.ik_branches import Branches, Poses, Solutions, distinct

ROBOT = read_cell(library("cells")["arc-welder"]).robot


@given(st.integers(0, 2**31), st.integers(1, 12))
def test_whole_turns_make_no_other_solution(seed, count):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2, 2, (count, 6))
    turned = q + 2 * np.pi * rng.integers(-1, 2, q.shape)
    pose = np.zeros(2 * count, dtype=int)

    index = distinct(ROBOT, pose, np.concatenate([q, turned]), most=100)

    assert len(index) == count
    assert len({int(i) % count for i in index}) == count


def test_no_more_solutions_of_a_pose_are_kept_than_asked_for_and_poses_keep_their_own(rng):
    pose = np.repeat([3, 5], 10)

    index = distinct(ROBOT, pose, rng.uniform(-2, 2, (20, 6)), most=4)

    assert np.bincount(pose[index]).tolist() == [0, 0, 0, 4, 0, 4]


def test_solutions_within_the_limits_may_lie_beyond_by_the_slack_and_no_more(rng):
    poses = Poses(np.zeros((1, 3)), np.eye(3)[None], np.zeros(1, dtype=int))
    q = np.stack([ROBOT.upper - 0.01, ROBOT.upper + 0.05, ROBOT.upper + 0.2])
    found = Solutions(poses, np.zeros(3, dtype=int), q)

    assert len(found.within(ROBOT).q) == 1
    assert len(found.within(ROBOT, 0.1).q) == 2


def test_poses_beside_known_ones_are_reached_within_the_limits(arc_welder, rng):
    q = rng.uniform(-0.4, 0.4, (300, 6)) + np.array([0.0, 0.1, 0.0, 0.0, 0.9, 0.0])
    position, rotation = arc_welder.kinematics.tip(q, arc_welder.theta)
    group = np.zeros(300, dtype=int)
    branches = Branches(arc_welder, arc_welder.theta, Poses(position[:200], rotation[:200], group[:200]), rng)

    found = branches.solve(Poses(position[200:], rotation[200:], group[200:]))

    p, R = arc_welder.kinematics.tip(found.q, arc_welder.theta)
    np.testing.assert_allclose(p, position[200:][found.pose], atol=1e-3)
    np.testing.assert_allclose(R, rotation[200:][found.pose], atol=1e-5)
    assert ((found.q >= ROBOT.lower - 1e-6) & (found.q <= ROBOT.upper + 1e-6)).all()
    assert len(np.unique(found.pose)) > 95  # of 100 that are known to have one
    assert len(found.q) == pytest.approx(4 * 100, rel=0.7)  # other branches as well
