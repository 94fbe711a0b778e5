"""Inverse kinematics is judged by independent forward kinematics, at poses made from known joint values."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import forward

from identify.model.cell import DEG
from identify.model.frames import rotation
from identify.model.ik import LEVER, reach, within, wrapped
from identify.model.io.description import library, read_robot
from identify.model.kinematics import Kinematics

KINEMATICS = {name: Kinematics(read_robot(path)) for name, path in library("robots").items()}


@pytest.fixture(params=KINEMATICS)
def kinematics(request):
    return KINEMATICS[request.param]


def placed(robot, rng):
    """Parameters of a robot that stands, carries and is built anyhow."""
    theta = robot.theta(np.array([300.0, -200, 400, 1, 0.1, -0.2]), np.array([10.0, 5, 380, 0.3, -0.4, 0.1]))
    return theta + rng.normal(size=theta.size) * np.where(robot.angular, 0.01, 2.0)


def poses(robot, theta, q):
    T = np.stack([forward(robot, row, theta) for row in q])
    return T[:, :3, 3], T[:, :3, :3]


def targets(kinematics, rng, n=40):
    """Poses that a robot can take, and joint values some way off."""
    robot, theta = kinematics.robot, placed(kinematics.robot, rng)
    span = robot.upper - robot.lower
    q = robot.lower + span * rng.uniform(0.2, 0.8, (n, len(robot.joints)))
    way = np.where(robot.prismatic, 30.0, 0.15)
    return theta, q, q + rng.uniform(-way, way, q.shape)


def test_targets_are_met(kinematics, rng):
    robot = kinematics.robot
    theta, q, start = targets(kinematics, rng)
    position, R = poses(robot, theta, q)

    found = reach(kinematics, theta, position, R, start)

    met = found.reached(1e-6)
    assert met.mean() > 0.9  # the others lie behind a singularity or a limit
    p, turned = poses(robot, theta, found.q[met])
    np.testing.assert_allclose(p, position[met], atol=1e-6)  # [mm]
    np.testing.assert_allclose(turned, R[met], atol=1e-8)
    assert within(robot, found.q[met]).all()


def test_what_is_left_is_reported_as_it_is(kinematics, rng):
    robot = kinematics.robot
    theta, q, start = targets(kinematics, rng)
    position, R = poses(robot, theta, q)
    far = position * 3 + 2000  # out of reach of every robot here

    found = reach(kinematics, theta, far, R, start)

    p, turned = poses(robot, theta, found.q)
    cosine = (np.einsum("mij,mij->m", turned, R) - 1) / 2
    left = np.hypot(np.linalg.norm(p - far, axis=1), LEVER * np.arccos(np.clip(cosine, -1, 1)))
    np.testing.assert_allclose(found.residual, left, rtol=1e-6)
    assert not found.reached().any()
    assert found.residual.min() > 500


def test_the_turn_about_the_wire_can_be_left_open(kinematics, rng):
    theta, q, start = targets(kinematics, rng)
    position, R = poses(kinematics.robot, theta, q)
    turned = R @ rotation(rng.uniform(-np.pi, np.pi, len(q)), np.zeros(len(q)), np.zeros(len(q)))

    found = reach(kinematics, theta, position, turned, start, free_roll=True)

    met = found.reached(1e-6)
    assert met.mean() > 0.9
    p, reached = poses(kinematics.robot, theta, found.q[met])
    np.testing.assert_allclose(p, position[met], atol=1e-6)
    np.testing.assert_allclose(reached[:, :, 2], R[met][:, :, 2], atol=1e-8)


def test_the_orientation_can_be_left_open(kinematics, rng):
    theta, q, start = targets(kinematics, rng)
    position, _ = poses(kinematics.robot, theta, q)

    found = reach(kinematics, theta, position, np.tile(np.eye(3), (len(q), 1, 1)), start, free_orientation=True)

    met = found.reached(1e-6)
    assert met.mean() > 0.9
    np.testing.assert_allclose(poses(kinematics.robot, theta, found.q[met])[0], position[met], atol=1e-6)


def test_a_target_half_a_turn_away_is_not_taken_for_reached(arc_welder):
    q = np.array([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]])
    position, R = arc_welder.kinematics.tip(q, arc_welder.theta)

    found = reach(arc_welder.kinematics, arc_welder.theta, position, R @ np.diag([1.0, -1.0, -1.0]), q, iterations=0)

    assert found.residual[0] == pytest.approx(LEVER * np.pi)


def test_starts_on_the_target_stay_there(arc_welder, rng):
    robot = arc_welder.robot
    q = rng.uniform(robot.lower, robot.upper, (300, 6))
    position, R = arc_welder.kinematics.tip(q, arc_welder.theta)

    found = reach(arc_welder.kinematics, arc_welder.theta, position, R, q)

    np.testing.assert_array_equal(found.q, q)


def test_a_robot_of_one_joint_reaches_what_it_can(arc_welder):
    """The defect: `check` of a robot.yaml that had lost its other joints ended in a traceback."""
    robot = replace(arc_welder.robot, joints=arc_welder.robot.joints[:1], capsules=())
    kinematics = Kinematics(robot)
    theta = np.zeros(len(robot.parameters))
    q = np.array([[0.3], [-0.7]])
    position, R = kinematics.tip(q, theta)

    found = reach(kinematics, theta, position, R, np.zeros_like(q))

    np.testing.assert_allclose(found.q, q, atol=1e-6)


def test_targets_do_not_disturb_each_other(arc_welder, rng):
    theta, q, start = targets(arc_welder.kinematics, rng, 300)
    position, R = poses(arc_welder.robot, theta, q)
    alone = [
        reach(arc_welder.kinematics, theta, position[i : i + 1], R[i : i + 1], start[i : i + 1]).q[0] for i in range(5)
    ]

    together = reach(arc_welder.kinematics, theta, position, R, start)

    np.testing.assert_allclose(together.q[:5], alone, atol=1e-9)


def test_whole_turns_bring_a_joint_within_its_limits():
    kinematics = KINEMATICS["puma560"]  # joint 4 turns from -266 to 266 degrees
    q = np.array([[0, 0, 0, 300, 0, 0], [200, 0, 0, 250, 0, -630]]) * DEG

    turned = wrapped(kinematics, q)

    np.testing.assert_allclose(turned / DEG, [[0, 0, 0, -60, 0, 0], [-160, 0, 0, 250, 0, 90]], atol=1e-9)
