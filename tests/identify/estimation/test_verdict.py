"""Measurements that no robot near the drawing explains: by robots whose mistake is made on purpose."""

from dataclasses import replace

import numpy as np
import pytest
from measured import poses_over_jig, positions_at

from identify.estimation.calibrate import CalibrationFailed, calibrate
from identify.estimation.verdict import hypotheses, refusals, with_promise
from identify.uncertainty.posterior import posterior


@pytest.fixture(scope="module")
def positions(arc_welder):
    """What a tracker sees of a robot off by a tenth of its tolerances."""
    rng = np.random.default_rng(12)
    truth = arc_welder.theta + 0.1 * arc_welder.spread * rng.standard_normal(len(arc_welder.theta))
    return positions_at(arc_welder, truth, poses_over_jig(arc_welder, 40, rng), rng)


def turned(positions, joint, sign=1.0, degrees=0.0):
    """The positions as a controller would record them that counts a joint otherwise."""
    q = positions.q.copy()
    q[:, joint] = sign * q[:, joint] - np.radians(degrees)
    return replace(positions, q=q)


def metres(positions, axis):
    point = positions.point.copy()
    point[:, axis] /= 1000
    return replace(positions, point=point)


def three_targets(positions):
    """Every third position is that of another target on the flange."""
    shift = np.array([[0, 0, 0], [80, 0, 0], [0, 60, 40]])[np.arange(len(positions.q)) % 3]
    return replace(positions, point=positions.point + shift)


def reasons(cell, measured):
    """Why it is refused: by no convergence, or by the verdict."""
    try:
        return refusals(calibrate(cell, measured, folds=0, errors="cell"))
    except CalibrationFailed as error:
        return (str(error),)


def test_a_good_calibration_is_not_refused(arc_welder, positions):
    assert reasons(arc_welder, positions) == ()


@pytest.mark.parametrize(
    ("mistake", "kind", "word"),
    [
        (lambda p: turned(p, 1, sign=-1.0), "joint sign", "sign: {j2: -1}"),
        (lambda p: turned(p, 0, degrees=180), "joint zero", "zero_deg: {j1: 180}"),
        (lambda p: metres(p, 1), "unit", "y_mm"),
    ],
)
def test_a_mistake_in_all_rows_is_refused_and_its_cure_is_proposed(arc_welder, positions, mistake, kind, word):
    measured = mistake(positions)

    assert reasons(arc_welder, measured)
    (finding,) = hypotheses(arc_welder, [measured])
    assert finding.kind == kind
    assert word in finding.text


def test_a_zero_that_is_off_by_37_degrees_is_estimated(arc_welder, positions):
    found = calibrate(arc_welder, turned(positions, 1, degrees=37), folds=0, errors="cell")

    assert refusals(found) == ()
    j2 = arc_welder.robot.parameters.index("j2.theta")
    assert np.degrees(found.theta[j2] - arc_welder.theta[j2]) == pytest.approx(37, abs=0.5)


def test_three_targets_in_one_file_are_refused(arc_welder, positions):
    assert reasons(arc_welder, three_targets(positions))


def test_the_promise_is_that_of_draws_from_what_the_calibration_says(arc_welder, positions):
    found = calibrate(arc_welder, positions, folds=0, errors="cell")
    known, rng = posterior(found), np.random.default_rng(0)
    q = poses_over_jig(arc_welder, 100, rng)

    at = arc_welder.kinematics.tip(q, found.theta)[0]
    off = np.stack([arc_welder.kinematics.tip(q, theta)[0] - at for theta in known.robots(200, rng)])

    assert with_promise(found).promise["rms_mm"] == pytest.approx(np.sqrt((off**2).sum(axis=2).mean()), rel=0.5)
