"""The arm behind the encoders: play, noise and bending."""

import numpy as np
import pytest
from virtual_robots import robot_at, tip
from virtual_support import with_effects

from identify.estimation.selection import with_errors
from probe.virtual.batch import search_end
from probe.virtual.truth import Truth

FAST, SLOW = np.radians(60), np.radians(0.6)


def test_backlash_leaves_the_arm_behind_the_encoders_by_half_the_play_on_each_side(arc_welder, exact, plan):
    play = np.radians(0.02)
    robot = robot_at(arc_welder, with_effects(exact, backlash=(0.0, play)), plan)
    there, back = plan.approach[0] + 0.01, plan.approach[0]

    robot.move(there, SLOW)
    ahead = robot.arm.geared - robot.q
    robot.move(back, SLOW)

    assert ahead == pytest.approx(np.full(6, -play / 2))
    assert robot.arm.geared - robot.q == pytest.approx(np.full(6, play / 2))


def test_joint_noise_scatters_contacts_and_is_told_to_the_judge(arc_welder, exact, plan):
    noise, end = np.radians(0.01), search_end(arc_welder, plan)[0]
    robot = robot_at(arc_welder, with_effects(exact, joint_noise=(0.0, noise)), plan)

    for _ in range(60):
        robot.search(end, SLOW)
        robot.move(plan.approach[0], FAST)

    off = np.array([t.arm - t.q for t in robot.touches])
    assert len(off) == 60
    assert np.std(off) == pytest.approx(noise, rel=0.15)
    faces = np.array([tip(arc_welder, t.arm) @ plan.normal[0] for t in robot.touches])
    assert np.ptp(faces) < 0.01  # the arm itself meets the face; only the tilt of the flat end changes


def test_a_robot_that_truly_bends_touches_where_it_truly_is(arc_welder, plan):
    bending = with_errors(arc_welder, ("compliance", "harmonics"))
    theta = bending.theta.copy()
    theta[bending.robot.parameters.index("j3.sag4")] = np.radians(0.5)
    truth = with_effects(Truth(theta, robot=bending.robot), sigma=0.0)
    robot = robot_at(arc_welder, truth, plan)
    face = arc_welder.jig.by_name[plan.face[0]]

    robot.search(plan.approach[0] + 2.4 * (plan.q[0] - plan.approach[0]), SLOW)

    position, R = bending.kinematics.tip(robot.touches[0].arm[None], theta)
    lean = face.normal @ R[0, :, 2]
    height = face.normal @ position[0] - face.offset - arc_welder.wire.radius * np.sqrt(1 - lean**2)
    assert abs(height) < 0.01  # [mm], what it moves in a servo step
    assert np.linalg.norm(position[0] - tip(arc_welder, robot.touches[0].arm)) > 0.5
