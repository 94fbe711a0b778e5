"""SciPy's racer gets the equations that ours has."""

import numpy as np
import pytest

from identify.model.measurement import measurement_model, rows
from studies.racers import with_scipy
from studies.racers.peers_problems import touches, tracker
from studies.racers.with_touchcal import cell_of, measured


@pytest.mark.parametrize("question", [tracker, touches])
def test_the_equations_that_scipy_gets_are_ours(question):
    told = question(np.random.default_rng(1), 40).told
    cell = cell_of(told)
    p = cell.theta + 0.3 * cell.prior * np.random.default_rng(2).standard_normal(42)

    theirs = with_scipy.residual(told)(p)

    ours = measurement_model(cell.robot).residual(p, rows(cell.wire, [measured(told)])) / told["sigma"]
    order = np.arange(len(ours)).reshape(-1, 3).T.ravel() if question is tracker else np.arange(len(ours))
    assert theirs[: len(ours)] == pytest.approx(ours[order], abs=1e-7)
    assert theirs[len(ours) :] == pytest.approx((p - cell.theta) / cell.prior)
