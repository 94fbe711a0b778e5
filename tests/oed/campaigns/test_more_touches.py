"""More touches like those that were made promise more, down to what faces and posts leave, and times tell how many."""

import re

import numpy as np
import pytest
from identified import identified
from measured import poses_over_jig, touches_at

from identify.model.zone import zone_poses
from identify.uncertainty.posterior import zone_promise
from identify.uncertainty.promise import TipErrors, promise
from oed.campaigns.more_touches import MoreTouches


@pytest.fixture(scope="module")
def more(arc_welder):
    rng = np.random.default_rng(1)
    touches = touches_at(arc_welder, arc_welder.theta, poses_over_jig(arc_welder, 40, rng), rng)
    names = [n for n, s in zip(arc_welder.robot.parameters, arc_welder.spread, strict=True) if s > 0]
    index = [arc_welder.robot.parameters.index(name) for name in names]
    covariance = np.diag((0.01 * arc_welder.prior[index]) ** 2)
    calibration = identified(arc_welder, arc_welder.theta, estimated=tuple(names), covariance=covariance)
    return MoreTouches(calibration, touches, zone_promise(calibration).p95_mm)


def test_once_is_what_the_calibration_promises_and_more_is_less(more):
    errors = [more.promised(times) for times in (1.0, 2.0, 8.0, 4096.0)]

    assert errors[0] == pytest.approx(more.now)
    assert errors == sorted(errors, reverse=True)
    assert more.floor == errors[-1]


def test_the_times_for_a_target_meet_it_and_hardly_fewer_do(more):
    target = 0.5 * (more.now + more.floor)

    times = more.times(target)

    assert more.promised(times) <= target
    assert more.promised(0.97 * times) > target


def test_a_target_below_the_floor_takes_endless_touches(more):
    assert more.times(0.9 * more.floor) == np.inf


def test_a_target_that_is_met_takes_no_more(more):
    assert more.times(1.1 * more.now) <= 1.0


def test_what_limits_the_tip_error_is_less_of_it_once_the_face_that_is_named_was_touched(more):
    axis, *place = re.search(r"along ([xyz]), near \((.*), (.*), (.*)\)", more.limit).groups()

    zone = zone_poses(more.calibration.cell, more.calibration.theta)
    tips = more.calibration.cell.kinematics.tip(zone, more.calibration.theta)[0]
    q = zone[np.argmin(np.linalg.norm(tips - np.array(place, float), axis=1))]
    after = more._prior.updated(more._rows)
    tip = more._prior.unknowns.tip_rows(zone, more.calibration.theta)
    gain = [
        promise(TipErrors(after.updated(row[None] / 0.05).root(tip))).p95_mm
        for row in more._prior.unknowns.tip_rows(q[None], more.calibration.theta)[0]
    ]

    assert "xyz"[int(np.argmin(gain))] == axis
    assert min(gain) < 0.95 * more._stated(1.0)
