"""Races between libraries: the same problem, another process, a limit of time."""

import numpy as np
import pytest

from identify.estimation.calibrate import calibrate
from identify.model.measurement import measurement_model, rows
from studies.racers import with_scipy
from studies.racers.peers_problems import touches, tracker
from studies.racers.racing import race
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


@pytest.mark.parametrize("question", [tracker, touches])
def test_all_find_the_same_robot(question):
    asked = question(np.random.default_rng(3), 60)

    cell = cell_of(asked.told)
    theta = calibrate(cell, measured(asked.told), loss="linear", folds=0, errors="cell").theta
    theirs = with_scipy.METHODS["SciPy trf"](dict(asked.told))["tip"]

    tip = cell.kinematics.tip(asked.told["q_unseen"], theta)[0]
    assert np.linalg.norm(tip - theirs, axis=1).max() < 0.01  # [mm]; our scatter may weigh the priors a little more
    assert np.linalg.norm(tip - asked.hidden, axis=1).mean() < 0.15


def test_a_racer_runs_in_a_process_of_its_own_and_is_measured():
    asked = tracker(np.random.default_rng(1), 40)

    found = race("with_scipy", "SciPy lm", asked.told, 20)

    assert found["tip"].shape == asked.hidden.shape
    assert 0 < found["cpu_s"] < 20
    assert 20 < found["peak_mb"] < 1000


def test_a_library_that_is_not_there_is_told():
    assert "cannot be imported: No module named 'with_nothing'" in race("with_nothing", "x", {}, 5)["result"]


def test_an_interpreter_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setenv("TOUCHCAL_PEERS_PYTHON", "/nowhere/python")

    assert "/nowhere/python cannot be run: No such file" in race("with_pybotics", "pybotics", {}, 5)["result"]


def test_a_racer_that_takes_too_long_is_stopped():
    rows = np.random.default_rng(0).standard_normal((300_000, 30))

    found = race("with_touchcal", "touchcal exact_design", {"rows": rows, "n": np.array(60)}, 1)

    assert list(found) == ["result"]
    assert found["result"].startswith("not finished after")


def test_a_racer_that_fails_says_why():
    assert "KeyError" in race("with_scipy", "SciPy lm", {}, 10)["result"]
