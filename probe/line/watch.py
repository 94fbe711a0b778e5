"""A watch on one motion: reported positions against the commanded segment and progress, and the touch input."""

import numpy as np
from jaxtyping import Float

from probe.line.clock import Clock

OFF = 0.05  # [deg] or [mm], off the segment, behind or ahead of where the robot can be: encoders tremble less
FASTER = 1.25  # times the commanded rate, beyond which a motion is too fast
LATE = 0.1  # [s] by which the clocks of host and controller may differ in the course of one motion
RUNS_ON = 0.5  # [s] at the commanded rate: braking after a contact takes 0.25 s at most
STALLED = 3.0  # [s] without progress


class Watch:
    """What a robot may report while it moves straight from `start` to `end` at a rate.

    Made before the command is sent: the robot cannot be further along than its own time since then allows. Progress
    counts in the driver's time, from the first report on: a report that waited while a simulated cell jumped on, or
    worked a motion out, is no standstill.
    """

    def __init__(
        self,
        start: Float[np.ndarray, " joints"],
        end: Float[np.ndarray, " joints"],
        rate: float,
        clock: Clock,
        *,
        from_contact: bool = False,
        off: float = OFF,
    ) -> None:
        """`start`, `end` in [deg] or [mm], `rate` of the fastest joint in [deg/s]; a retract begins `from_contact`."""
        self._start, self._line, self._rate = start, end - start, rate
        self._span = float(np.abs(self._line).max())
        self._square = float(self._line @ self._line)
        self._clock, self._began = clock, clock.robot()
        self._from_contact, self._off = from_contact, off
        self._farthest = 0.0  # [deg] along the segment
        self._progress, self._progressed = 0.0, np.inf  # [deg] at the last progress, and when it was heard
        self._closed_at: float | None = None  # [deg] along the segment, where the input was first seen closed

    def objection(self, q: Float[np.ndarray, " joints"], closed: bool, *, stands: bool = False) -> str:
        """What is wrong with a position [deg] or [mm] that a moving robot reports, or nothing.

        Of one that says that it `stands`, before or after its motion, no progress is expected. Some say so while they
        move: none can be further along than its time allows.
        """
        now, away = self._clock.now(), q - self._start
        fraction = float(away @ self._line) / self._square if self._square else 0.0
        off = float(np.abs(away - fraction * self._line).max())
        along = fraction * self._span
        if off > self._off:
            return f"{off:.2f} deg off the commanded path"
        possible = FASTER * self._rate * (self._clock.robot() - self._began + LATE) + OFF
        if along > possible:
            return f"{along:.2f} deg along its path, expected at most {possible:.2f} deg at {self._rate:.2f} deg/s"
        if stands:
            return ""
        if along > self._span + OFF:
            return f"{along - self._span:.2f} deg beyond the end of the commanded path"
        if along < self._farthest - OFF:
            return f"moved back by {self._farthest - along:.2f} deg on its path"
        if along > self._progress + OFF / 10 or self._span - along < OFF or np.isinf(self._progressed):
            self._progress, self._progressed = along, now
        self._farthest = max(self._farthest, along)
        if now - self._progressed > STALLED:
            return f"no progress for {now - self._progressed:.1f} s, {along:.2f} of {self._span:.2f} deg along its path"
        return self._runs_on(along, closed)

    def _runs_on(self, along: float, closed: bool) -> str:
        """Whether the robot goes on although the touch input has closed; a flicker starts the count anew."""
        if not closed or self._from_contact:
            self._closed_at = None
            return ""
        self._closed_at = along if self._closed_at is None else self._closed_at
        ran = along - self._closed_at
        return f"{ran:.2f} deg further with the touch input closed" if ran > RUNS_ON * self._rate + OFF else ""
