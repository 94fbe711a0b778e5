"""Races between libraries: another process, a limit of time."""

import numpy as np

from studies.racers.racing import race


def test_an_interpreter_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setenv("TOUCHCAL_PEERS_PYTHON", "/nowhere/python")

    assert "/nowhere/python cannot be run: No such file" in race("with_pybotics", "pybotics", {}, 5)["result"]


def test_a_racer_that_takes_too_long_is_stopped():
    rows = np.random.default_rng(0).standard_normal((300_000, 30))

    found = race("with_touchcal", "touchcal exact_design", {"rows": rows, "n": np.array(60)}, 1)

    assert list(found) == ["result"]
    assert found["result"].startswith("not finished after")
