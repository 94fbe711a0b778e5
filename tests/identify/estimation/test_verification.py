from dataclasses import replace

import numpy as np
import pytest
from measured import poses_over_jig, positions_at, table_2, touches_at

from identify.estimation.calibrate import calibrate
from identify.estimation.verification import beyond, verify
from identify.model.files import InputError
from identify.model.io.calibration_file import summarize

SIGMA = 0.05  # [mm]


@pytest.fixture(scope="module")
def poses(arc_welder):
    return poses_over_jig(arc_welder, 500, np.random.default_rng(5))


@pytest.fixture(scope="module")
def truth(arc_welder):
    return table_2(arc_welder)


@pytest.fixture(scope="module")
def calibration(arc_welder, poses, truth):
    return calibrate(
        arc_welder, touches_at(arc_welder, truth, poses[:100], np.random.default_rng(1), SIGMA), errors="cell"
    )


def test_unseen_positions_are_within_what_was_promised(calibration, arc_welder, poses, truth, rng):
    found = verify(calibration, positions_at(arc_welder, truth, poses[100:], rng, SIGMA))

    assert found.nominal.rms_mm > 15
    assert found.identified.n == 400
    assert found.identified.p95_mm == pytest.approx(found.promised_p95_mm, rel=0.5)


def test_what_is_promised_is_kept_by_nearly_all_fits_and_is_not_much_more(arc_welder, poses, truth):
    """95 of 100 fits stay below the promise at 95 % of the touches, and the median is near it."""
    rng = np.random.default_rng(2)
    below = []
    for _ in range(20):
        q = poses[rng.permutation(500)]
        found = calibrate(arc_welder, touches_at(arc_welder, truth, q[:60], rng, SIGMA), folds=0, errors="cell")
        unseen = verify(found, touches_at(arc_welder, truth, q[60:], rng, SIGMA))
        below.append(unseen.identified.p95_mm / unseen.promised_p95_mm)

    assert np.mean(np.array(below) <= 1) >= 0.85  # of 20: three standard deviations below 95 %
    assert np.median(below) > 0.75


def test_touches_that_were_used_are_refused_even_in_another_file(calibration, arc_welder, poses, truth):
    used = touches_at(arc_welder, truth, poses[:100], np.random.default_rng(1), SIGMA)
    renamed = replace(used, ids=tuple(f"new{i}" for i in range(100))).take(np.arange(90, 100))
    fresh = touches_at(arc_welder, truth, poses[100:120], np.random.default_rng(9), SIGMA)

    with pytest.raises(InputError, match="10 of 30 measurements were used in the fit"):
        verify(calibration, renamed, fresh)


def test_nothing_to_verify_with_is_said(calibration, arc_welder, poses, truth, rng):
    none = touches_at(arc_welder, truth, poses[:5], rng).take(np.arange(0))

    with pytest.raises(InputError, match="nothing to verify"):
        verify(calibration, none)


def test_a_summary_is_that_of_numpy(rng):
    distance = rng.normal(size=101)

    found = summarize(distance)

    assert found.mean_mm == pytest.approx(np.abs(distance).mean())
    assert found.rms_mm == pytest.approx(distance.std(mean=0.0))
    assert found.p95_mm == pytest.approx(np.sort(np.abs(distance))[95])
    assert found.max_mm == np.abs(distance).max()


def test_names_with_spaces_are_said_as_they_are(arc_welder, poses, truth, rng):
    robot = arc_welder.robot
    joints = tuple(replace(joint, name=f"Axis {i}") for i, joint in enumerate(robot.joints, 1))
    cell = replace(arc_welder, robot=replace(robot, joints=joints))
    found = calibrate(cell, touches_at(cell, truth, poses[:60], rng, SIGMA), errors="cell")

    places = beyond(found, poses + 1.0)

    assert any(place.startswith("Axis 1 above") and " deg: " in place for place in places)
