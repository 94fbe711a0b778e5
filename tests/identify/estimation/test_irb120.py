"""Real measurements: an ABB IRB 120 seen by a laser tracker; the numbers that the data set is known for."""

import numpy as np
import pytest
from irb120 import positions, single_coordinates

from identify.estimation.calibrate import calibrate
from identify.estimation.folds import regions

DRAWS = 8


def unseen_error(irb120_cell, irb120_measured, kind, seed):
    """Mean error in space at the 400 poses that 100 drawn ones leave."""
    order = np.random.default_rng(seed).permutation(500)
    found = calibrate(irb120_cell, kind(irb120_measured, order[:100]), folds=0, errors="cell")
    tip = irb120_cell.kinematics.tip(irb120_measured["q"][order[100:]], found.theta)[0]
    return np.linalg.norm(tip - irb120_measured["point"][order[100:]], axis=1).mean()


@pytest.mark.parametrize(("kind", "limit"), [(single_coordinates, 0.20), (positions, 0.19)])
def test_100_poses_bring_400_unseen_ones_within_a_fifth_of_a_millimetre(kind, limit, irb120_cell, irb120_measured):
    errors = [unseen_error(irb120_cell, irb120_measured, kind, seed) for seed in range(DRAWS)]

    assert np.median(errors) <= limit


def test_joints_read_back_before_the_robot_settled_fit_worse(irb120_cell, irb120_measured):
    which = np.arange(0, 500, 2)

    commanded = calibrate(irb120_cell, positions(irb120_measured, which), errors="cell")
    readback = calibrate(irb120_cell, positions(irb120_measured, which, "readback"), errors="cell")

    assert readback.scatter > 1.5 * commanded.scatter
    assert readback.scatter_significant
    assert readback.held_out.rms_mm > 1.3 * commanded.held_out.rms_mm


def test_errors_in_regions_held_out_tell_more_than_those_of_the_fit(irb120_cell, irb120_measured):
    found = calibrate(irb120_cell, positions(irb120_measured, np.arange(500)), errors="cell")

    assert found.held_out.mean_mm > 1.2 * found.fit.mean_mm


def chosen_error(irb120_cell, irb120_measured, train, test, kind=positions):
    """Errors in space at unseen poses, of the joint errors that the program chose from the seen ones."""
    found = calibrate(irb120_cell, kind(irb120_measured, train), folds=0, errors="auto")
    tip = found.cell.kinematics.tip(irb120_measured["q"][test], found.theta)[0]
    return np.linalg.norm(tip - irb120_measured["point"][test], axis=1)


def left_out_in_turn(irb120_cell, irb120_measured, label):
    folds = [(np.flatnonzero(label != k), np.flatnonzero(label == k)) for k in np.unique(label)]
    return np.concatenate([chosen_error(irb120_cell, irb120_measured, train, test) for train, test in folds])


def test_joint_errors_chosen_by_the_data_reach_a_tenth_of_a_millimetre_in_regions_unseen(irb120_cell, irb120_measured):
    errors = left_out_in_turn(
        irb120_cell, irb120_measured, regions(irb120_measured["point"], 5, np.random.default_rng(0))
    )

    assert len(errors) == 500
    assert errors.mean() <= 0.08  # 0.10 was asked for; the geometric model has 0.24
    assert errors.max() <= 0.30  # 0.50; 1.2


def test_joint_errors_chosen_by_the_data_reach_less_at_poses_drawn_anywhere(irb120_cell, irb120_measured, rng):
    errors = left_out_in_turn(irb120_cell, irb120_measured, rng.permutation(500) % 5)

    assert errors.mean() <= 0.07  # 0.08 was asked for; the geometric model has 0.19


@pytest.mark.parametrize("seed", range(3))
def test_300_single_coordinates_are_enough_to_choose_joint_errors(seed, irb120_cell, irb120_measured):
    order = np.random.default_rng(seed).permutation(500)

    errors = chosen_error(irb120_cell, irb120_measured, order[:300], order[300:], single_coordinates)

    assert errors.mean() <= 0.10  # 0.13 was asked for
