"""A racer in a process of its own: measured, or told why it did not finish."""

import numpy as np

from studies.racers.peers_problems import tracker
from studies.racers.racing import race


def test_a_racer_runs_in_a_process_of_its_own_and_is_measured():
    asked = tracker(np.random.default_rng(1), 40)

    found = race("with_scipy", "SciPy lm", asked.told, 20)

    assert found["tip"].shape == asked.hidden.shape
    assert 0 < found["cpu_s"] < 20
    assert 20 < found["peak_mb"] < 1000


def test_a_library_that_is_not_there_is_told():
    assert "cannot be imported: No module named 'with_nothing'" in race("with_nothing", "x", {}, 5)["result"]


def test_a_racer_that_fails_says_why():
    assert "KeyError" in race("with_scipy", "SciPy lm", {}, 10)["result"]
