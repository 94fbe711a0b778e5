"""How far along its path a robot is at a time: constant accelerations, piece after piece."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.robot import Robot

NOWHERE = 1e-12  # [rad] or [mm], what rounding leaves of no distance
RAMP = 0.2  # [s] from rest to full joint speed


@dataclass(frozen=True)
class Piece:
    """From a time on: a fraction of the path, its first and its second derivative by time."""

    start: float  # [s]
    fraction: float
    speed: float  # [1/s]
    acceleration: float  # [1/s^2]

    def at(self, time: float) -> tuple[float, float]:
        """Fraction and speed at a time."""
        t = time - self.start
        return self.fraction + (self.speed + self.acceleration * t / 2) * t, self.speed + self.acceleration * t


@dataclass(frozen=True)
class Profile:
    """The fraction of a path that lies behind, as a function of time; it never goes back."""

    pieces: tuple[Piece, ...]
    end: float  # [s], at rest from then on
    braking: float  # [1/s^2]

    def at(self, time: float) -> tuple[float, float]:
        """Fraction and speed [1/s] at a time."""
        if time >= self.end:
            return self.pieces[-1].at(self.end)[0], 0.0
        piece = self.pieces[0]
        for later in self.pieces[1:]:
            piece = later if later.start <= time else piece
        return piece.at(max(time, piece.start))

    def time(self, fraction: float) -> float:
        """When a fraction is reached; inf where the motion ends before."""
        ends = [*(piece.start for piece in self.pieces[1:]), self.end]
        for piece, end in zip(self.pieces, ends, strict=True):
            if piece.at(end)[0] >= fraction:
                rise, v, a = fraction - piece.fraction, piece.speed, piece.acceleration
                return (
                    piece.start + 2 * rise / (v + np.sqrt(max(v**2 + 2 * a * rise, 0.0))) if rise > 0 else piece.start
                )
        return np.inf

    def stopped(self, time: float) -> "Profile":
        """The same motion until a time, and then braked to rest; nothing changes where it brakes already."""
        if time >= self.end or (self.pieces[-1].acceleration < 0 and time >= self.pieces[-1].start):
            return self
        fraction, speed = self.at(time)
        pieces = tuple(piece for piece in self.pieces if piece.start < time)
        return Profile(
            (*pieces, Piece(time, fraction, speed, -self.braking)), time + speed / self.braking, self.braking
        )


def straight(
    robot: Robot, start: Float[np.ndarray, " joints"], end: Float[np.ndarray, " joints"], rate: float, time: float
) -> Profile:
    """A motion from rest to rest; `rate` [rad/s] is of the joint that the controller counts
    fastest, a sliding joint's mm/s counting as deg/s.

    No joint is driven faster than it can, nor accelerated faster than to its full speed in `RAMP`.
    """
    distance = np.abs(end - start)
    if distance.max() < NOWHERE:
        return Profile((Piece(time, 1.0, 0.0, -1.0),), time, 1.0)
    with np.errstate(divide="ignore"):
        fastest = float(np.min(robot.speed / distance))
    counts = np.abs(robot.to_controller(end) - robot.to_controller(start))
    speed = min(float(np.degrees(rate) / np.max(counts)), fastest)
    ramp = fastest / RAMP
    rise = min(speed**2 / (2 * ramp), 0.5)
    speed = np.sqrt(2 * ramp * rise)
    up, level = speed / ramp, (1 - 2 * rise) / speed
    pieces = (
        Piece(time, 0.0, 0.0, ramp),
        Piece(time + up, rise, speed, 0.0),
        Piece(time + up + level, 1 - rise, speed, -ramp),
    )
    return Profile(pieces, time + 2 * up + level, ramp)
