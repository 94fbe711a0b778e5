"""A silent line is opened anew and asked again, until patience is over; nothing is faster than the system can be."""

import pytest
from touching import Ticks

from probe.line.clock import Clock
from probe.line.controller import LinkLost, Refused
from probe.line.retry import Timing, patiently


class Line:
    """A line that is lost so many times, each loss taking a second, and then answers."""

    def __init__(self, losses: int, clock: Ticks) -> None:
        self.losses, self.clock, self.opened = losses, clock, 0

    def ask(self) -> str:
        if self.losses:
            self.losses -= 1
            self.clock.sleep(1.0)
            raise LinkLost("silent")
        return "answer"

    def reopen(self) -> None:
        self.opened += 1


def test_a_lost_line_is_opened_once_for_each_loss_and_asked_again() -> None:
    line = Line(3, clock := Ticks())

    assert patiently(line.ask, line.reopen, clock, 5.0) == "answer"

    assert line.opened == 3


def test_a_line_that_stays_lost_is_given_up_when_patience_is_over() -> None:
    line = Line(100, clock := Ticks())
    began = clock.now()

    with pytest.raises(LinkLost, match="silent"):
        patiently(line.ask, line.reopen, clock, 5.0)

    assert 5.0 < clock.now() - began <= 6.1


def test_what_the_controller_refuses_is_not_asked_again() -> None:
    line = Line(0, clock := Ticks())

    def refused() -> str:
        raise Refused("LIMIT")

    with pytest.raises(Refused):
        patiently(refused, line.reopen, clock, 5.0)

    assert line.opened == 0


def test_a_faster_clock_is_never_more_impatient_on_the_wall_than_the_system_allows() -> None:
    real, fast = Timing.of(Clock()), Timing.of(Clock(1000.0))

    assert real == Timing()
    assert fast.patience / 1000 == pytest.approx(4.0)
    assert fast.heartbeat / 1000 < fast.resend / 1000 < fast.silence / 1000
