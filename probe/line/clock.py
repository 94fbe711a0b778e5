"""Time as the controller counts it, so that a simulated cell may run faster than the wall clock."""

import time
from collections.abc import Callable
from datetime import UTC, datetime


class Clock:
    """Seconds of the controller: real ones, or shorter where a simulated cell runs `scale` times faster.

    Everything in probe counts in these seconds; only the transport waits in real ones. A simulated cell that jumps over
    its motions has a time of its own, `robot`, by which a run is as long as it would be in truth.
    """

    def __init__(self, scale: float = 1.0, robot: Callable[[], float] | None = None) -> None:
        self.scale = scale
        self.robot = robot or self.now  # [s]

    def now(self) -> float:
        """A time that only grows [s]."""
        return time.monotonic() * self.scale

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(self.real(seconds))

    def real(self, seconds: float) -> float:
        """How long the wall clock runs in so many seconds of the controller [s]."""
        return max(seconds, 0.0) / self.scale

    def at_least(self, seconds: float, real: float) -> float:
        """A time limit, never shorter than `real` on the wall: the operating system itself needs that long [s]."""
        return max(seconds, real * self.scale)

    def stamp(self) -> str:
        """Date and time of day on the wall, UTC, ISO 8601."""
        return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
