"""Real measurements: an ABB IRB 120 seen by a laser tracker; the numbers that the data set is known for."""

import numpy as np
import pytest

from identify.estimation.calibrate import calibrate
from identify.estimation.folds import regions
from identify.model.cell import Cell, Wire
from identify.model.io.description import library, read_robot
from identify.model.touch import HIT, Positions, Touches

DRAWS = 8
SIGMA = 0.1  # [mm], repeatability of the robot by its data sheet, rounded up


@pytest.fixture(scope="module")
def cell():
    """Nobody measured where the tracker stands and where the reflector sits."""
    return Cell(read_robot(library("robots")["irb120"]), None, base=None, tool=None, wire=Wire(0.0, "point"))


@pytest.fixture(scope="module")
def measured(shared_data):
    data = np.genfromtxt(shared_data / "irb120" / "positions.csv", delimiter=",", names=True)

    def columns(*names):
        return np.column_stack([data[name] for name in names])

    return {
        "q": np.radians(columns(*(f"q{i}_deg" for i in range(1, 7)))),
        "readback": np.radians(columns(*(f"q{i}_readback_deg" for i in range(1, 7)))),
        "point": columns("x_mm", "y_mm", "z_mm"),
    }


def positions(measured, which, joints="q"):
    ids = tuple(str(i) for i in which)
    return Positions(ids, measured[joints][which], measured["point"][which], np.full(len(which), SIGMA))


def single_coordinates(measured, which):
    """One coordinate a pose, x, y, z in turn, as a touch on a plane would give it."""
    m, blank = len(which), ("",) * len(which)
    normal = np.eye(3)[np.arange(m) % 3]
    offset = (normal * measured["point"][which]).sum(axis=1)
    ids = tuple(str(i) for i in which)
    return Touches(ids, blank, measured["q"][which], normal, offset, np.full(m, SIGMA), (HIT,) * m, np.full(m, np.nan),
                   blank, blank)  # fmt: skip


def unseen_error(cell, measured, kind, seed):
    """Mean error in space at the 400 poses that 100 drawn ones leave."""
    order = np.random.default_rng(seed).permutation(500)
    found = calibrate(cell, kind(measured, order[:100]), folds=0)
    tip = cell.kinematics.tip(measured["q"][order[100:]], found.theta)[0]
    return np.linalg.norm(tip - measured["point"][order[100:]], axis=1).mean()


@pytest.mark.parametrize(("kind", "limit"), [(single_coordinates, 0.20), (positions, 0.19)])
def test_100_poses_bring_400_unseen_ones_within_a_fifth_of_a_millimetre(kind, limit, cell, measured):
    errors = [unseen_error(cell, measured, kind, seed) for seed in range(DRAWS)]

    assert np.median(errors) <= limit


def test_joints_read_back_before_the_robot_settled_fit_worse(cell, measured):
    which = np.arange(0, 500, 2)

    commanded = calibrate(cell, positions(measured, which))
    readback = calibrate(cell, positions(measured, which, "readback"))

    assert readback.scatter > 1.5 * commanded.scatter
    assert readback.scatter_significant
    assert readback.held_out.rms_mm > 1.3 * commanded.held_out.rms_mm


def test_errors_in_regions_held_out_tell_more_than_those_of_the_fit(cell, measured):
    found = calibrate(cell, positions(measured, np.arange(500)))

    assert found.held_out.mean_mm > 1.2 * found.fit.mean_mm


def chosen_error(cell, measured, train, test, kind=positions):
    """Errors in space at unseen poses, of the joint errors that the program chose from the seen ones."""
    found = calibrate(cell, kind(measured, train), folds=0, choose=True)
    tip = found.cell.kinematics.tip(measured["q"][test], found.theta)[0]
    return np.linalg.norm(tip - measured["point"][test], axis=1)


def left_out_in_turn(cell, measured, label):
    folds = [(np.flatnonzero(label != k), np.flatnonzero(label == k)) for k in np.unique(label)]
    return np.concatenate([chosen_error(cell, measured, train, test) for train, test in folds])


def test_joint_errors_chosen_by_the_data_reach_a_tenth_of_a_millimetre_in_regions_unseen(cell, measured):
    errors = left_out_in_turn(cell, measured, regions(measured["point"], 5, np.random.default_rng(0)))

    assert len(errors) == 500
    assert errors.mean() <= 0.08  # 0.10 was asked for; the geometric model has 0.24
    assert errors.max() <= 0.30  # 0.50; 1.2


def test_joint_errors_chosen_by_the_data_reach_less_at_poses_drawn_anywhere(cell, measured, rng):
    errors = left_out_in_turn(cell, measured, rng.permutation(500) % 5)

    assert errors.mean() <= 0.07  # 0.08 was asked for; the geometric model has 0.19


@pytest.mark.parametrize("seed", range(3))
def test_300_single_coordinates_are_enough_to_choose_joint_errors(seed, cell, measured):
    order = np.random.default_rng(seed).permutation(500)

    errors = chosen_error(cell, measured, order[:300], order[300:], single_coordinates)

    assert errors.mean() <= 0.10  # 0.13 was asked for
