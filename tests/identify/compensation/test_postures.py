"""Postures of the nominal robot: a path keeps its own."""

import numpy as np
from identified import poses_at

from identify.compensation.postures import nominal, regular_branch
from identify.compensation.trust import smallest
from identify.model.frames import transform
from identify.model.ik import reach


def test_a_path_keeps_its_posture(arc_welder):
    q = np.linspace([0.2, 0.1, 0.3, 0.4, 0.9, 0.2], [0.5, 0.3, 0.1, 0.3, 1.1, 0.5], 100)
    T = transform(poses_at(arc_welder, q))

    found, reached = nominal(arc_welder.kinematics, arc_welder.theta, T)

    assert reached.all()
    assert np.abs(np.diff(found, axis=0)).max() < 0.1


def test_a_named_posture_is_the_one_that_is_kept(arc_welder):
    q = np.array([[0.2, 0.1, 0.3, 0.4, 0.9, 0.2]])
    flipped = np.array([0.2, 0.1, 0.3, 0.4 - np.pi, -0.9, 0.2 - np.pi])
    T = transform(poses_at(arc_welder, q))

    upright = nominal(arc_welder.kinematics, arc_welder.theta, T, q[0])[0]
    turned = nominal(arc_welder.kinematics, arc_welder.theta, T, flipped)[0]

    assert np.abs(upright - q).max() < 1e-6
    assert turned[0, 4] < -0.8
    assert np.abs(transform(poses_at(arc_welder, turned)) - T).max() < 1e-4


def test_of_all_branches_neighbouring_poses_get_the_one_that_stays_farthest_from_singular(arc_welder, rng):
    robot, kinematics = arc_welder.robot, arc_welder.kinematics
    q = np.linspace([0.2, 0.1, 0.3, 0.4, 0.9, 0.2], [0.5, 0.3, 0.1, 0.3, 1.1, 0.5], 4)
    T = transform(poses_at(arc_welder, q))
    everything = np.repeat(T, 200, axis=0)
    start = rng.uniform(robot.lower, robot.upper, (len(everything), len(robot.joints)))
    ends = reach(kinematics, arc_welder.theta, everything[:, :3, 3], everything[:, :3, :3], start)
    regular = np.where(ends.reached(), smallest(kinematics, arc_welder.theta, ends.q), 0.0).reshape(4, 200)

    start = regular_branch(kinematics, arc_welder.theta, T)
    joints, reached = nominal(kinematics, arc_welder.theta, T, start)

    assert reached.all()
    assert np.abs(np.diff(joints, axis=0)).max() < 0.5
    assert smallest(kinematics, arc_welder.theta, joints).min() > 0.9 * regular.max(axis=1).min()
