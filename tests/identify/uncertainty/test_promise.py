"""The promise, held against closed forms of the normal distribution."""

import numpy as np
import pytest
from scipy.stats import chi, norm

from identify.uncertainty.promise import Promise, TipErrors, deviations, promise


def test_the_promise_at_one_pose_is_the_95th_percentile_of_the_chi_distribution():
    made = promise(TipErrors(0.2 * np.eye(3)[None]))

    assert made.rms_mm == pytest.approx(0.2 * np.sqrt(3))
    assert made.p95_mm == pytest.approx(0.2 * chi(3).ppf(0.95), rel=0.05)  # 1000 draws stand for the integral


def test_the_promise_takes_95_percent_of_the_poses_and_of_the_robots():
    """One direction moves pose k by k millimetres: 95 % of 200 poses stay below 190 |z|."""
    root = np.zeros((200, 3, 1))
    root[:, 0, 0] = np.arange(1, 201)

    made = promise(TipErrors(root))

    assert made.p95_mm == pytest.approx(190 * norm.ppf(0.975), rel=0.05)


def test_a_direction_that_is_known_exactly_adds_no_error():
    assert promise(TipErrors(np.diag([0.1, 0.0, 0.0])[None])).rms_mm == pytest.approx(0.1)


def test_the_spread_of_models_widens_the_promise_and_a_model_counts_by_its_weight():
    apart = np.array([[3.0, 0.0, 0.0]])
    near = TipErrors(0.1 * np.eye(3)[None], weight=0.97)

    rare, often = (promise(near, TipErrors(0.1 * np.eye(3)[None], apart, weight)) for weight in (0.03, 0.97))

    assert rare.p95_mm < 0.5
    assert often.p95_mm == pytest.approx(3.0, abs=0.3)
    assert often.rms_mm == pytest.approx(np.sqrt(0.03 + 9 / 2))


def test_what_is_not_determined_cannot_be_promised():
    assert promise(TipErrors(np.full((2, 3, 1), np.inf))).p95_mm == np.inf


def test_the_deviation_at_a_pose_holds_all_models():
    models = [TipErrors(np.eye(3)[None]), TipErrors(np.eye(3)[None], np.array([[0.0, 2.0, 0.0]]))]

    assert deviations(models) == pytest.approx(np.sqrt([3 + 4 / 2]))


def test_an_rms_above_the_95_percent_is_explained_and_a_usual_one_is_not():
    rare, usual = Promise(rms_mm=0.5, p95_mm=0.2), Promise(rms_mm=0.1, p95_mm=0.2)

    assert "fewer than 5 of 100" in rare.sentences()[0]
    assert usual.sentences() == ()
