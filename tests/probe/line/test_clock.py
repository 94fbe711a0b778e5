"""Seconds of the controller and seconds on the wall."""

import pytest

from probe.line.clock import Clock


def test_a_faster_clock_waits_shorter_on_the_wall_but_never_too_short() -> None:
    clock = Clock(20.0)

    assert clock.real(2.0) == pytest.approx(0.1)
    assert clock.at_least(0.2, 0.05) == pytest.approx(1.0)
    assert clock.at_least(30.0, 0.05) == 30.0
