"""The robot of the hostile bench as it truly is: where the tip was at every moment, reckoned by no line of identify.

Its kinematics are the elementary motions of the paper (`oracle`) multiplied out; its jig is a list of boxes. It writes
down every motion that the robot really made, and every moment at which the touch input was forced.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from oracle import motions
from touching import Ticks, World

from identify.model.cell import Cell

FINE = 65  # samples of each halving of a path


@dataclass(frozen=True, eq=False)
class Moved:
    """A motion that the robot truly made."""

    start: np.ndarray  # [rad]
    end: np.ndarray
    began: float  # [s]
    ended: float
    searching: bool  # whether its controller took it for a search

    @property
    def nowhere(self) -> bool:
        return bool(np.abs(self.end - self.start).max() < 1e-7)


class Chain:
    """Where the tip is, for a robot of given parameters."""

    def __init__(self, cell: Cell, theta: np.ndarray) -> None:
        robot, count = cell.robot, len(cell.robot.joints)
        assert not any(robot.prismatic), "the hostile bench has turning joints only"
        joints = {6 + 5 * i: i for i in range(count)}  # by the parameter that the turn of a joint carries
        parts = [np.eye(4) for _ in range(count + 1)]  # constant transforms before, between and behind the joints
        at = 0
        for motion in motions(robot, np.zeros(count), theta):
            if motion.carries in joints and motion.kind == "R":
                at = joints[motion.carries] + 1
            parts[at] = parts[at] @ motion.matrix
        *before, last = parts
        self._rows = [part[:3].tolist() for part in before]
        self._last = last[:3, 3].tolist()

    def tip(self, q: np.ndarray) -> np.ndarray:
        """Tip positions [mm], rows of joints [rad]."""
        one = len(q) == 1  # plain numbers are ten times faster than arrays of one
        sine, cosine = (math.sin, math.cos) if one else (np.sin, np.cos)
        x, y, z = self._last
        for angle, (a, b, c) in zip(reversed(q[0].tolist() if one else q.T), reversed(self._rows), strict=True):
            s, k = sine(angle), cosine(angle)
            x, y = k * x - s * y, s * x + k * y
            x, y, z = (row[0] * x + row[1] * y + row[2] * z + row[3] for row in (a, b, c))
        return np.array([[x, y, z]]) if one else np.stack([x, y, z], axis=1)


class TrueWorld(World):
    """A robot before a jig that remembers all that truly happened; `chatter` [s] after each change of the contact."""

    def __init__(self, cell: Cell, theta: np.ndarray, clock: Ticks, q: np.ndarray) -> None:
        super().__init__(cell, theta, clock, q)
        self.record: list[Moved] = []
        self.forced: list[list[float]] = []  # from when to when [s] the input reads closed whatever the wire does
        self.chatter, self.changed = 0.0, -1e9
        self._known: tuple[bytes, float] = b"", 0.0

    @cached_property
    def chain(self) -> Chain:
        return Chain(self.cell, self.theta)

    @cached_property
    def _boxes(self) -> tuple[np.ndarray, np.ndarray]:
        assert self.cell.jig is not None
        lower = np.array([box.lower for box in self.cell.jig.boxes], dtype=float)
        return lower[:, None], np.array([box.upper for box in self.cell.jig.boxes], dtype=float)[:, None]

    def depth(self, q: np.ndarray) -> np.ndarray:
        lower, upper = self._boxes
        tip = self.chain.tip(q)
        return np.minimum(tip - lower, upper - tip).min(axis=2).max(axis=0)

    def touching(self, q: np.ndarray | None = None) -> bool:
        q = self.q if q is None else q
        if self._known[0] != q.tobytes():
            self._known = q.tobytes(), float(self.depth(q[None])[0])
        return self._known[1] >= 0 and not self.open_wire

    def first_contact(self, start: np.ndarray, end: np.ndarray) -> float | None:
        if self.open_wire:
            return None
        low, high, count = 0.0, 1.0, 400
        while high - low > 1e-11:
            s = np.linspace(low, high, count)
            inside = np.flatnonzero(self.depth(start + s[:, None] * (end - start)) >= 0)
            if not len(inside):
                return None
            if inside[0] == 0:
                return 0.0
            low, high, count = float(s[inside[0] - 1]), float(s[inside[0]]), FINE
        return high

    def force(self, seconds: float) -> None:
        """Have the input read closed for so long from now on."""
        self.forced.append([self.clock.t, self.clock.t + seconds])

    def release(self) -> None:
        """A person frees the input."""
        for window in self.forced:
            window[1] = min(window[1], self.clock.t)

    def is_forced(self, time: float) -> bool:
        return any(since <= time < until for since, until in self.forced)

    def reads(self, touching: bool) -> bool:
        """What the input reads now, where the wire touches or not."""
        t = self.clock.t
        if self.is_forced(t):
            return True
        if 0 <= t - self.changed < self.chatter:
            return bool(int(t * 1000) * 2654435761 >> 16 & 1)
        return touching or t < self.ended + self.hold

    def moved(self, start: np.ndarray, end: np.ndarray, began: float, ended: float, *, searching: bool) -> None:
        """Write down a motion that has ended."""
        before, after = self.touching(start), self.touching(end)
        if before and not after:
            self.ended = ended
        self.changed = ended if before != after else self.changed
        self.q = end.copy()
        self.record.append(Moved(start.copy(), self.q, began, ended, searching))
