"""Postures of an elbow arm: the nearest one that fits, whole turns within the limits, and where there is none."""

import numpy as np
import pytest
from cells import cell_of

from identify.programs.posture import Chooser, elbow


@pytest.fixture(scope="module")
def chooser():
    cell = cell_of("irb120")
    return cell, Chooser(cell.kinematics, cell.theta, cell.robot)


def target(cell, q):
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :3, 3], T[:, :3, :3] = cell.kinematics.tip(q, cell.theta)
    return T


Q = np.array([[0.3, 0.2, -0.2, 0.4, 0.9, 0.5]])


def everything(postures):
    return np.ones(len(postures.degrees), dtype=bool)


def test_a_posture_that_reaches_the_target_and_is_nearest_is_chosen(chooser):
    cell, choose = chooser

    (choice,) = choose.choose(target(cell, Q), [everything], Q[0], [True])

    np.testing.assert_allclose(choice.q, Q[0], atol=1e-5)
    assert choice.fits
    assert choice.others  # the other wrist at least
    for q in choice.others:
        np.testing.assert_allclose(target(cell, q[None]), target(cell, Q), atol=1e-2)


def test_flags_decide_among_the_solutions(chooser):
    cell, choose = chooser

    (choice,) = choose.choose(target(cell, Q), [lambda p: p.degrees[:, 4] < 0], Q[0], [False])

    assert choice.fits
    assert choice.q[4] < 0
    np.testing.assert_allclose(target(cell, choice.q[None]), target(cell, Q), atol=1e-2)


def test_where_no_solution_fits_the_nearest_is_told_as_not_fitting(chooser):
    cell, choose = chooser

    (choice,) = choose.choose(target(cell, Q), [lambda p: p.degrees[:, 0] > 1e3], Q[0], [False])

    assert (choice.fits, choice.solved) == (False, True)


def test_a_target_out_of_reach_has_no_solution(chooser):
    cell, choose = chooser
    T = target(cell, Q)
    T[0, :3, 3] += 5000.0

    (choice,) = choose.choose(T, [everything], Q[0], [False])

    assert (choice.fits, choice.solved) == (False, False)
    assert np.isnan(choice.q).all()


def test_sides_change_where_the_arm_turns_over(chooser):
    _, choose = chooser
    forward = np.array([0.0, 0.3, 0.0, 0.0, 0.5, 0.0])
    back = np.array([0.0, -1.6, 0.0, 0.0, 0.5, 0.0])  # the upper arm leans back over axis 1

    sides = choose.postures(np.stack([forward, back]))

    assert sides.front.tolist() == [True, False]


@pytest.mark.parametrize(("name", "expected"), [("irb120", True), ("puma560", True), ("arm7", None), ("scara", None)])
def test_elbow_arms_are_told_by_their_axes(name, expected):
    cell = cell_of(name)

    assert elbow(cell.kinematics, cell.theta) is expected


def test_the_pose_of_the_base_changes_nothing(chooser):
    cell, choose = chooser
    moved = cell.theta.copy()
    moved[:6] = [100.0, 900.0, -50.0, 2.0, 0.3, -0.2]

    other = Chooser(cell.kinematics, moved, cell.robot)

    q = np.random.default_rng(1).uniform(cell.robot.lower, cell.robot.upper, (20, 6))
    np.testing.assert_array_equal(other.postures(q).front, choose.postures(q).front)
    np.testing.assert_array_equal(other.postures(q).above, choose.postures(q).above)
