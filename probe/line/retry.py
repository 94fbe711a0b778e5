"""How long the host waits, and what it does meanwhile: a silent line is opened anew and asked again."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from probe.line.clock import Clock
from probe.line.controller import LinkLost

T = TypeVar("T")


@dataclass(frozen=True)
class Timing:
    """How patient the host is [s of the controller]."""

    heartbeat: float = 0.2  # between two `! HB`; the controller's deadman is 0.75 s
    resend: float = 0.4  # without a sign of life before a line is sent again
    silence: float = 1.5  # without a valid line before the port is opened anew
    patience: float = 5.0  # before the controller is given up
    slack: float = 5.0  # beyond the expected duration of a motion before it is stopped

    @classmethod
    def of(cls, clock: Clock) -> "Timing":
        """The usual patience, but never shorter than an operating system under load needs on the wall."""
        return cls(
            heartbeat=clock.at_least(cls.heartbeat, 0.005),
            resend=clock.at_least(cls.resend, 0.05),
            silence=clock.at_least(cls.silence, 1.0),
            patience=clock.at_least(cls.patience, 4.0),
            slack=clock.at_least(cls.slack, 5.0),
        )


def patiently(call: Callable[[], T], reopen: Callable[[], None], clock: Clock, patience: float) -> T:
    """Call, and where the line is lost open it anew and call again; raises LinkLost when patience [s] is over."""
    deadline = clock.now() + patience
    while True:
        try:
            return call()
        except LinkLost:
            if clock.now() > deadline:
                raise
        reopen()
