"""How studies judge a promise, on numbers counted by hand."""

import numpy as np
import pytest
from identified import identified

from identify.model.calibration import SharedValue
from studies.common import REFUSED, judged, kept, picture_of_promises

TABLE = {"promised_mm": [0.2, 0.4, 0.1, float("nan")], "delivered_mm": [0.1, 0.1, 0.2, 9.0]}


def test_robots_without_a_promise_do_not_count_and_the_others_count_once():
    good, share, width = kept(TABLE)

    assert good.tolist() == [True, True, True, False]
    assert share == pytest.approx(100 * 2 / 3)
    assert width == pytest.approx(2.0)  # of 2, 4 and 0.5


def test_an_interval_holds_what_lies_within_two_deviations(arc_welder):
    theta = arc_welder.theta.copy()
    names = arc_welder.robot.parameters
    face = SharedValue("face.top", "mm", 0.03, 0.02)
    joint = np.diag([1e-8, 1e-8])
    calibration = identified(arc_welder, theta, shared=(face,), covariance=joint[:1, :1], shared_covariance=joint[1:])
    truth = {"base.x": theta[0] + 1.9, "base.y": theta[1] + 2.1, "face.top": 0.03}

    found = judged(calibration, np.array([3.0, 4.0]), truth, dict.fromkeys(truth, 1.0) | {names[5]: 1.0})

    assert found["covered"] == pytest.approx(2 / 3)
    assert found["rms_mm"] == pytest.approx(np.sqrt(12.5))
    assert found["delivered_mm"] == pytest.approx(3.95)
    assert found.keys() == REFUSED.keys()


def test_the_picture_has_a_dot_for_each_promise_with_its_name():
    picture = picture_of_promises(TABLE, ["a", "b", "c", "d"])

    assert [name in picture for name in ("a: 0.100 mm", "b: 0.100 mm", "c: 0.200 mm", "d:")] == [
        True,
        True,
        True,
        False,
    ]
