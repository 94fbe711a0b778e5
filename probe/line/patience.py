"""A line that falls silent is opened anew and asked again, for as long as patience lasts."""

from collections.abc import Callable
from typing import TypeVar

from probe.line.clock import Clock
from probe.line.controller import LinkLost

T = TypeVar("T")


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
