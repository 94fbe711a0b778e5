"""Ours and SciPy find the same robot."""

import numpy as np
import pytest

from identify.estimation.calibrate import calibrate
from studies.racers import with_scipy
from studies.racers.peers_problems import touches, tracker
from studies.racers.with_touchcal import cell_of, measured


@pytest.mark.parametrize("question", [tracker, touches])
def test_all_find_the_same_robot(question):
    asked = question(np.random.default_rng(3), 60)

    cell = cell_of(asked.told)
    theta = calibrate(cell, measured(asked.told), loss="linear", folds=0, errors="cell").theta
    theirs = with_scipy.METHODS["SciPy trf"](dict(asked.told))["tip"]

    tip = cell.kinematics.tip(asked.told["q_unseen"], theta)[0]
    assert np.linalg.norm(tip - theirs, axis=1).max() < 0.01  # [mm]; our scatter may weigh the priors a little more
    assert np.linalg.norm(tip - asked.hidden, axis=1).mean() < 0.15
