"""Corrected targets are where a hidden true robot goes; what cannot be trusted is left alone."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identified, poses_at
from measured import poses_over_jig, table_2, touches_at
from oracle import forward

import identify
from identify.compensation.compensate import CHANGE, allowed_change, believed, compensate, jig_T_frame
from identify.compensation.trust import RESIDUAL
from identify.estimation.calibrate import calibrate
from identify.estimation.selection import with_errors
from identify.model.files import InputError
from identify.model.frames import inverse, pose, transform
from identify.model.ik import reach
from probe.virtual.truth import draw_truth, read_truth, truths

DEG = np.pi / 180


@pytest.fixture(scope="module")
def targets(arc_welder):
    """Joints and tip poses of 1000 targets in the weld zone."""
    q = poses_over_jig(arc_welder, 1000, np.random.default_rng(7))
    return q, poses_at(arc_welder, q)


def driven(cell, command, start, truth):
    """Where a true tip goes when its nominal controller is told poses in the jig frame [mm]."""
    T = transform(command)
    q = reach(cell.kinematics, cell.theta, T[:, :3, 3], T[:, :3, :3], start).q
    return cell.kinematics.tip(q, truth)[0]


def test_the_front_page_names_it():
    assert identify.compensate is compensate


def test_a_thousand_targets_on_a_hidden_robot_end_within_what_the_calibration_promised(arc_welder, targets):
    truth = read_truth(truths()["arc-welder"], arc_welder).theta
    rng = np.random.default_rng(12)
    found = calibrate(
        arc_welder,
        touches_at(arc_welder, truth, poses_over_jig(arc_welder, 100, rng), rng),
        parameters="identifiable",
        errors="cell",
    )
    wanted = targets[1]

    result = compensate(found, wanted)

    done = result.corrected
    before = np.linalg.norm(driven(arc_welder, wanted[done], result.nominal[done], truth) - wanted[done, :3], axis=1)
    after = np.linalg.norm(driven(arc_welder, result.command[done], result.q[done], truth) - wanted[done, :3], axis=1)
    variance = np.trace(found.tip_covariance(result.q[done]), axis1=1, axis2=2)
    promised_p95 = np.percentile(np.abs(rng.standard_normal((500, 1, 3)) * np.sqrt(variance / 3)[:, None]), 95)
    assert done.mean() > 0.95
    assert before.mean() > 15
    assert np.sqrt(np.mean(after**2)) < 1.5 * np.sqrt(variance.mean()) < 0.1  # one robot of the many promised for
    assert np.percentile(after, 95) < 2 * promised_p95
    assert after.max() < 0.3


def test_targets_left_alone_are_named_and_untouched(exact, targets):
    q, wanted = targets

    result = compensate(exact, wanted, near=q, max_change=2 * DEG)

    left = ~result.corrected
    assert 0 < left.sum() < len(wanted)
    assert np.array_equal(result.command[left], wanted[left])
    assert np.array_equal(result.q[left], result.nominal[left])
    assert all(any(joint in result.why[i] for joint in "123456") for i in np.flatnonzero(left))
    assert sum(result.left().values()) == left.sum()


def test_the_command_is_where_the_nominal_robot_stands_at_the_corrected_joints(arc_welder, exact, targets):
    q, wanted = targets[0][:20], targets[1][:20]

    result = compensate(exact, wanted, near=q)

    for i in np.flatnonzero(result.corrected):
        nominal_tip = forward(arc_welder.robot, result.q[i], arc_welder.theta)
        true_tip = forward(arc_welder.robot, result.q[i], exact.theta)
        assert np.abs(transform(result.command[i]) - nominal_tip).max() < 1e-8
        assert np.abs(transform(wanted[i]) - true_tip)[:3, 3].max() < RESIDUAL


def test_residuals_of_all_that_was_corrected_are_below_a_micrometre(exact, targets):
    result = compensate(exact, targets[1])

    assert result.residual[result.corrected].max() < 1e-3


def test_a_robot_that_is_as_the_controller_believes_is_told_what_it_was_told(arc_welder, targets):
    result = compensate(identified(arc_welder, arc_welder.theta), targets[1], near=targets[0])

    assert result.corrected.all()
    assert np.abs(transform(result.command) - transform(targets[1])).max() < 1e-5  # [mm], what reach() leaves


@pytest.mark.parametrize("seed", range(3))
def test_robots_drawn_from_the_tolerances_are_corrected_everywhere_but_where_it_is_said(seed, arc_welder, targets):
    truth = draw_truth(arc_welder, np.random.default_rng(seed), scale=0.3).theta
    q, wanted = targets[0][:200], targets[1][:200]

    result = compensate(identified(arc_welder, truth), wanted, near=q)

    done = result.corrected
    reached = driven(arc_welder, result.command[done], result.q[done], truth)
    assert done.mean() > 0.8
    assert np.abs(reached - wanted[done, :3]).max() < 1.1e-3


def test_the_same_targets_in_jig_base_and_user_frame_get_the_same_joints(arc_welder, exact, targets):
    q, wanted = targets[0][:50], targets[1][:50]
    base_T_user = np.array([300.0, -200.0, 100.0, 0.3, -0.2, 0.1])

    in_jig = compensate(exact, wanted, near=q)

    for frame in ("base", base_T_user):
        jig_T_user = jig_T_frame(arc_welder.theta, frame)
        result = compensate(exact, pose(inverse(jig_T_user) @ transform(wanted)), frame=frame, near=q)
        assert np.abs(result.q - in_jig.q).max() < 1e-9
        assert np.abs(jig_T_user @ transform(result.command) - transform(in_jig.command)).max() < 1e-6


def test_a_base_found_elsewhere_moves_commands_fixed_to_the_jig_and_not_those_fixed_to_the_robot(arc_welder, targets):
    q, wanted = targets[0][:50], targets[1][:50]
    moved = arc_welder.theta.copy()
    moved[:6] += [3.0, -2.0, 1.0, 0.01, 0.0, 0.0]
    in_base = pose(inverse(transform(arc_welder.theta[:6])) @ transform(wanted))

    to_jig = compensate(identified(arc_welder, moved), in_base, frame="base", near=q)
    to_robot = compensate(identified(arc_welder, moved), in_base, frame="base", fixed_to="robot", near=q)

    assert np.abs(to_robot.command - in_base).max() < 1e-6
    done = to_jig.corrected
    expected = pose(inverse(transform(moved[:6])) @ transform(wanted))
    assert np.abs(transform(to_jig.command[done]) - transform(expected[done])).max() < 1e-4


def test_a_base_and_a_tool_to_be_fitted_are_believed_as_found(arc_welder):
    open_cell = replace(arc_welder, base=None, tool=None)
    theta = table_2(arc_welder)

    told = believed(identified(open_cell, theta))

    assert np.array_equal(told[:6], theta[:6])
    assert np.array_equal(told[-6:], theta[-6:])
    assert np.array_equal(told[6:-6], arc_welder.theta[6:-6])


def test_free_roll_changes_the_turn_about_the_wire_and_nothing_else(arc_welder, exact):
    q = np.array([[0.2, 0.1, 0.3, 0.4, 0.9, -3.13]])  # joint 6 next to its limit of 180 degrees
    wanted = poses_at(arc_welder, q)

    fixed = compensate(exact, wanted, near=q)
    free = compensate(exact, wanted, near=q, free_roll=True)

    true = transform(poses_at(arc_welder, free.q, exact.theta))[0]
    assert not fixed.corrected[0]
    assert free.corrected[0]
    assert np.abs(true[:3, 3] - wanted[0, :3]).max() < 1e-3
    assert np.abs(true[:3, 2] - transform(wanted)[0, :3, 2]).max() < 1e-5


def test_a_robot_nearly_right_is_allowed_three_degrees_and_one_far_off_more(arc_welder, exact):
    slightly = arc_welder.theta.copy()
    slightly[arc_welder.robot.parameters.index("j2.theta")] += 0.1 * DEG

    assert allowed_change(identified(arc_welder, slightly)) == CHANGE
    assert allowed_change(exact) > CHANGE


def test_no_targets_are_no_trouble(exact):
    result = compensate(exact, np.empty((0, 6)))

    assert (result.q.shape, result.command.shape, result.why) == ((0, 6), (0, 6), ())


def test_a_start_of_the_wrong_shape_is_refused(exact, targets):
    with pytest.raises(InputError, match="near has shape"):
        compensate(exact, targets[1][:3], near=np.zeros(5))


def test_a_robot_that_bends_and_turns_unevenly_goes_where_it_is_told(arc_welder, targets):
    bending = with_errors(arc_welder, ("harmonics", "compliance", "backlash"))
    rng, names = np.random.default_rng(3), bending.robot.parameters
    theta = bending.theta.copy()
    theta[[names.index(name) for name in arc_welder.robot.parameters]] = table_2(arc_welder)
    errors = slice(6 + 5 * len(bending.robot.joints), -6)
    theta[errors] = bending.scale[errors] * rng.standard_normal(len(theta[errors]))
    wanted = targets[1][:200]

    result = compensate(identified(bending, theta), wanted)

    done = result.corrected
    after = driven(arc_welder, result.command[done], result.q[done], arc_welder.theta)  # the controller's own belief
    reached = bending.kinematics.tip(result.q[done], theta)[0]
    unaware = compensate(identified(arc_welder, table_2(arc_welder)), wanted)
    off = bending.kinematics.tip(unaware.q[done], theta)[0] - wanted[done, :3]
    assert done.mean() > 0.9
    assert np.abs(reached - wanted[done, :3]).max() < 0.001  # [mm]
    assert np.linalg.norm(off, axis=1).mean() > 0.2
    np.testing.assert_allclose(after, arc_welder.kinematics.tip(result.q[done], arc_welder.theta)[0], atol=1e-3)


def test_degrees_are_answered_with_the_cure(exact, targets):
    poses = targets[1][:3].copy()
    poses[:, 3:] = np.degrees(poses[:, 3:])

    with pytest.raises(InputError, match=r"rad: degrees\? functions take radians"):
        compensate(exact, poses)
    with pytest.raises(InputError, match=r"rad: degrees\? functions take radians"):
        compensate(exact, targets[1][:3], near=np.array([90.0, -40, 30, 0, 60, 10]))
