"""The arm behind the encoders: play in its gears, noise in its joints, a wire at its end, and what it touches."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.kinematics import Kinematics
from probe.virtual.batch import joint_spread
from probe.virtual.collision import MOST as LOOKS
from probe.virtual.collision import STEP, Collision, Surroundings
from probe.virtual.contact import INTERVAL, Paths, first_contact, touching
from probe.virtual.motion import Profile
from probe.virtual.surfaces import surfaces
from probe.virtual.truth import Truth

NEVER = float("inf")
LONG_AGO = float("-inf")
MOST = 4096  # intervals of the longest path
CONTACTS = 4  # that are looked for on one path
CLEAR = 0.01  # [mm] beyond the place where a contact opens, from where on the next contact is looked for


@dataclass(frozen=True)
class Closed:
    """A stretch of a path over which the contact is closed, in fractions of the path."""

    enter: float  # -inf: it is closed where the path begins
    leave: float  # inf: to the end and beyond
    surface: str = ""  # what is met


@dataclass(frozen=True, eq=False)
class Trip:
    """One path of the arm, and where on it the contact is closed."""

    paths: Paths
    off: Float[np.ndarray, " joints"]  # noise of the joints, part of `paths`
    closed: tuple[Closed, ...]  # in their order
    collision: Collision | None = None  # of arm or torch

    def arm(self, fraction: float) -> Float[np.ndarray, " joints"]:
        """True joints at a fraction."""
        return self.paths.at(np.zeros(1, dtype=int), np.array([fraction]))[0]

    def state(self, profile: Profile, time: float) -> tuple[bool, float]:
        """Whether the contact is closed at a time, and since when [s]."""
        behind = profile.at(time)[0]
        edges = [edge for stretch in self.closed for edge in (stretch.enter, stretch.leave) if edge <= behind]
        since = profile.time(edges[-1]) if edges and edges[-1] > LONG_AGO else LONG_AGO
        return len(edges) % 2 == 1, since

    def contact(self, profile: Profile, settled: float = 0.0) -> Closed | None:
        """The first contact that closes on the way, after the input was open for `settled` [s] if it was closed."""
        opened = LONG_AGO
        for stretch in self.closed:
            if stretch.enter > LONG_AGO and profile.time(stretch.enter) > opened + settled:
                return stretch
            opened = profile.time(stretch.leave)
        return None


class Arm:
    """Where the arm truly is, and how it gets elsewhere."""

    def __init__(self, cell: Cell, truth: Truth, rng: np.random.Generator, q: Float[np.ndarray, " joints"]) -> None:
        if cell.jig is None:
            raise ValueError("a virtual cell needs a jig to touch; name one in cell.yaml (jig: library:step-block)")
        self.cell, self.truth, self.rng = cell, truth, rng
        self.kinematics = Kinematics(truth.robot or cell.robot)  # of its own: it may live in a thread of its own
        self.surroundings = Surroundings(cell, truth.robot or cell.robot)
        self.surroundings.prepare()
        self.surface = surfaces(cell.jig, cell.wire, truth.faces, cell.obstacles)
        self.sigma = cell.touch.sigma if truth.effects.sigma is None else truth.effects.sigma
        self.noise = joint_spread(cell, truth.effects.joint_noise)
        self.play = joint_spread(cell, truth.effects.backlash) / 2
        self.contacts = 0
        self.geared = q.copy()  # joints behind the gears, without noise
        self._obstacle: tuple[np.ndarray, np.ndarray] | None = None  # a place and a direction, in joint space
        self._draw()
        here = self._paths(q, q)
        self.closed = bool(touching(self.kinematics, self.surface, here, np.zeros(1), np.array([self.shift]))[0])
        self.changed = LONG_AGO

    def _draw(self) -> None:
        """What differs from touch to touch."""
        self.theta = self.truth.after(self.contacts)
        self.shift = float(self.sigma * self.rng.standard_normal())
        self.off = self.noise * self.rng.standard_normal(len(self.noise))

    def _paths(self, start: np.ndarray, end: np.ndarray) -> Paths:
        start, end, geared = ((q + self.off)[None] for q in (start, end, self.geared))
        return Paths(start, end, self.theta, geared, self.play)

    def follow(self, start: Float[np.ndarray, " joints"], end: Float[np.ndarray, " joints"]) -> Trip:
        """The path of the arm when the encoders go straight from `start` to `end`."""
        if not self.closed:
            self._draw()
        paths, length = self._paths(start, end), self._length(start, end)
        closed = [Closed(LONG_AGO, self._opening(paths, start, end))] if self.closed else []
        step = CLEAR / max(length, CLEAR)
        at = closed[0].leave + step if closed else 0.0
        while at < 1 and len(closed) < CONTACTS:
            rest = _rest(paths, at)
            count = int(np.clip(np.ceil((1 - at) * length / INTERVAL), 1, MOST))
            fraction, met, _ = first_contact(self.kinematics, self.surface, rest, np.array([self.shift]), count)
            enter = at + (1 - at) * float(fraction[0])
            if fraction[0] > 1 or enter + step >= 1:
                closed += [Closed(enter, NEVER, self.surface.names[met[0]])] if fraction[0] <= 1 else []
                break
            at = enter + step
            leave = at + (1 - at) * self._solid_opening(_rest(paths, at))
            closed.append(Closed(enter, leave, self.surface.names[met[0]]))
            at = leave + step
        return Trip(paths, self.off, tuple(closed), self._collision(paths, length))

    def _collision(self, paths: Paths, length: float) -> Collision | None:
        """What arm or torch hit first, whether or not the wire stops the robot before that."""
        looks = int(np.clip(length / STEP, 2, LOOKS))
        q = paths.at(np.zeros(looks, dtype=int), np.linspace(0.0, 1.0, looks))
        return self.surroundings.first(q, self.theta)

    def _length(self, start: np.ndarray, end: np.ndarray) -> float:
        """A bound on the way of the tip [mm]."""
        robot = self.cell.robot
        links = sum(abs(joint.a) + abs(joint.d) for joint in robot.joints)
        slides = sum(max(abs(j.lower), abs(j.upper)) for j in robot.joints if j.prismatic)
        fixed = sum(np.linalg.norm(T[:3, 3]) for T in (robot.base_T_first, robot.last_T_flange))
        reach = links + slides + float(fixed) + float(np.linalg.norm(self.theta[-6:-3]))
        return float(np.abs(end - start) @ np.where(robot.prismatic, 1.0, reach))

    def _opening(self, paths: Paths, start: np.ndarray, end: np.ndarray) -> float:
        """Up to which fraction the contact stays closed on a path that begins closed; inf: to its end and beyond."""
        solid = self._solid_opening(paths)
        if self._obstacle is None:
            return solid
        place, direction = self._obstacle
        before, after = float((start - place) @ direction), float((end - place) @ direction)
        if before < 0:
            return solid
        return max(solid, before / (before - after) if after < 0 else NEVER)

    def _solid_opening(self, paths: Paths) -> float:
        """Where the wire leaves the jig: the first open one of many samples, then halved in."""
        low, high = 0.0, 1.0
        for _ in range(6):
            at = np.linspace(low, high, 65)
            closed = self._touching(paths, at)
            if closed.all():
                return NEVER
            first = int(np.argmin(closed))
            if first == 0:
                return 0.0
            low, high = float(at[first - 1]), float(at[first])
        return high

    def _touching(self, paths: Paths, fraction: np.ndarray) -> np.ndarray:
        count = len(fraction)
        start, end, geared = (
            np.repeat(a, count, axis=0) for a in (paths.start, paths.end, paths.held) if a is not None
        )
        many = Paths(start, end, paths.theta, geared, paths.play)
        return touching(self.kinematics, self.surface, many, fraction, np.full(count, self.shift))

    def obstruct(self, trip: Trip, fraction: float) -> Trip:
        """Something conducting stands at a fraction of a path, until a motion has ended clear of it."""
        if any(LONG_AGO < stretch.enter <= fraction for stretch in trip.closed):
            return trip
        start, end = trip.paths.start[0] - trip.off, trip.paths.end[0] - trip.off
        self._obstacle = start + fraction * (end - start), end - start
        began = [stretch for stretch in trip.closed if stretch.enter == LONG_AGO]
        for stretch in began:
            if stretch.leave >= fraction:
                return replace(trip, closed=(Closed(LONG_AGO, NEVER),))
        return replace(trip, closed=(*began, Closed(fraction, NEVER)))

    def rest(self, trip: Trip, profile: Profile, time: float) -> None:
        """The motion has ended."""
        self.geared = trip.arm(profile.at(time)[0]) - trip.off
        self.closed, self.changed = trip.state(profile, time)
        if not self.closed:
            self._obstacle = None

    def count(self) -> None:
        """One contact more: the wire may be cut or fed after it."""
        self.contacts += 1


def _rest(paths: Paths, fraction: float) -> Paths:
    """What is left of one path from a fraction on."""
    return replace(paths, start=paths.start + fraction * (paths.end - paths.start))
