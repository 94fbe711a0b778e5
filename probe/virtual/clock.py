"""Controller time against the time of the host: at a factor, or as fast as possible."""

import time


class Clock:
    """Controller time [s]: `speed` times as fast as the host's; where that is infinite, time jumps over motions."""

    def __init__(self, speed: float = 1.0) -> None:
        if not speed > 0:
            raise ValueError(f"speed is {speed:g}, expected a factor above 0, or inf for as fast as possible")
        self.jumps = speed == float("inf")
        self.speed = 1.0 if self.jumps else speed
        self._began, self._skipped = time.monotonic(), 0.0

    def now(self) -> float:
        """Controller time [s] since the start."""
        return (time.monotonic() - self._began) * self.speed + self._skipped

    def jump(self, to: float) -> None:
        """Skip to a controller time that lies ahead."""
        self._skipped += max(0.0, to - self.now())

    def wait(self, until: float) -> float:
        """The host's time [s] from now to a controller time."""
        return max(0.0, (until - self.now()) / self.speed)
