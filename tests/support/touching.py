"""A small robot before the jig, in time that only passes when somebody waits: what the driver is tested against.

It shares nothing with probe but the vocabulary of identify.model and the Protocol it pretends to be.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from virtual_support import make_plan

from identify.model.cell import Cell, Wire
from identify.model.touch import Plan
from probe.line.clock import Clock
from probe.line.controller import Contact, Latch, NoContact, Refused, State

SERVO = 0.001  # [s]


class Ticks(Clock):
    """Time that passes only where somebody sleeps or listens."""

    def __init__(self) -> None:
        super().__init__()
        self.t = 100.0

    def now(self) -> float:
        return self.t

    def sleep(self, seconds: float) -> None:
        self.t += max(seconds, 0.0)

    def stamp(self) -> str:
        return f"2026-01-01T00:00:{self.t:07.3f}Z"


class World:
    """A robot with true parameters, straight in joint space, and a jig that conducts."""

    def __init__(self, cell: Cell, theta: np.ndarray, clock: Ticks, q: np.ndarray, boot: str = "A1B2") -> None:
        self.cell, self.theta, self.clock = cell, theta, clock
        self.boot, self.q = boot, q.copy()
        self.delay = 0.0  # [s], of the relay
        self.over = 0.02  # [s], to stop
        self.stuck = self.open_wire = False
        self.hold = 0.0  # [s], the sensing signal stays after the contact ended
        self.ended = -1e9  # [s], when the last contact ended
        self.motions: list[tuple[np.ndarray, np.ndarray]] = []  # what it really did
        self.truth: list[np.ndarray] = []  # joints at every physical contact of a search

    def depth(self, q: np.ndarray) -> np.ndarray:
        """How deep the true tip is inside the jig [mm], for rows of joints; negative outside."""
        tip = self.cell.kinematics.tip(q, self.theta)[0]
        assert self.cell.jig is not None
        inside = [np.minimum(tip - b.lower, np.array(b.upper) - tip).min(axis=1) for b in self.cell.jig.boxes]
        return np.max(inside, axis=0)

    def touching(self, q: np.ndarray | None = None) -> bool:
        return bool(self.depth((self.q if q is None else q)[None])[0] >= 0) and not self.open_wire

    def reads(self, touching: bool) -> bool:
        """What the input reads now, where the wire touches or not."""
        return self.stuck or touching or self.clock.t < self.ended + self.hold

    @property
    def closed(self) -> bool:
        return self.reads(self.touching())

    def first_contact(self, start: np.ndarray, end: np.ndarray) -> float | None:
        """Fraction of a straight path at which the tip enters the jig."""
        s = np.linspace(0, 1, 400)
        inside = np.flatnonzero(self.depth(start + s[:, None] * (end - start)) >= 0)
        if self.open_wire or not len(inside):
            return None
        if inside[0] == 0:
            return 0.0
        low, high = s[inside[0] - 1], s[inside[0]]
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (low, middle) if self.touching(start + middle * (end - start)) else (middle, high)
        return float(high)

    def duration(self, start: np.ndarray, end: np.ndarray, rate: float) -> float:
        return float(np.abs(end - start).max() / rate)

    def go(self, end: np.ndarray, fraction: float) -> None:
        start = self.q
        if self.touching(start):
            self.ended = self.clock.t
        self.q = start + fraction * (end - start)
        self.motions.append((start, self.q))


class Direct:
    """A Controller without a line: the robot itself, with failures to order by command."""

    def __init__(self, world: World) -> None:
        self.world, self.name, self.joints = world, "a robot in the test", len(world.q)
        self.last, self._latch = 0, None
        self.fail: list[object] = []  # for the next motions: None, an exception, or a function of (kind, target)
        self.log: list[str] = []

    @property
    def sequence(self) -> int:
        return self.last + 1

    def state(self) -> State:
        self.world.clock.sleep(0.002)
        return State(self.world.boot, False, self.world.closed, self.world.q.copy(), self.last)

    def _begin(self, kind: str, q: np.ndarray) -> object:
        self.last += 1
        self.log.append(kind)
        failure = self.fail.pop(0) if self.fail else None
        if isinstance(failure, Exception):
            raise failure
        return failure(kind, q) if callable(failure) else None

    def move(self, q: np.ndarray, rate: float) -> np.ndarray:
        self._begin("move", q)
        world = self.world
        start, from_contact = world.q, world.closed
        world.clock.sleep(world.duration(start, q, rate))
        hit = None if from_contact else world.first_contact(start, q)
        world.go(q, 1.0 if hit is None else hit)
        if hit is not None:
            raise Refused("EARLY")
        return world.q.copy()

    def search(self, q: np.ndarray, rate: float) -> Contact | NoContact:
        answer = self._begin("search", q)
        world = self.world
        if answer is not None:
            return answer
        if world.closed:
            raise Refused("ALREADY")
        start, duration = world.q, world.duration(world.q, q, rate)
        hit = world.first_contact(start, q)
        if hit is None:
            world.clock.sleep(duration)
            world.go(q, 1.0)
            return NoContact(world.q.copy())
        world.truth.append(start + hit * (q - start))
        latched = np.ceil((hit * duration + world.delay) / SERVO) * SERVO / duration
        stop = latched + world.over / duration
        world.clock.sleep(stop * duration)
        world.go(q, stop)
        self._latch = Latch(start + latched * (q - start), world.boot, self.last)
        return Contact(self._latch.q, world.q.copy(), world.boot, self.last)

    def latch(self) -> Latch | None:
        return self._latch

    def stop(self) -> None:
        self.log.append("stop")

    def close(self) -> None:
        self.log.append("close")


def pointed(cell: Cell) -> Cell:
    """The same cell with a wire that is a point, as the World has it."""
    return replace(cell, wire=Wire(0.0, "point"))


def clear_plan(cell: Cell, count: int, seed: int = 1) -> Plan:
    """Touches in an order in which the tip stays well clear of the jig between them."""
    plan = make_plan(cell, 3 * count, seed)
    order, rest = [0], list(range(1, len(plan)))
    while rest and len(order) < count:
        step = next((i for i in rest if _clear(cell, plan.approach[order[-1]], plan.approach[i])), None)
        if step is None:
            order.pop()
            order = order or [rest.pop(0)]
            continue
        order.append(step)
        rest.remove(step)
    assert len(order) == count, f"{len(order)} of {count} touches can be ordered"
    plan = plan.take(np.array(order))
    assert all(_clear(cell, a, b) for a, b in pairwise(plan.approach))
    return replace(plan, ids=tuple(f"t{i + 1:03d}" for i in range(count)))


def _clear(cell: Cell, a: np.ndarray, b: np.ndarray, margin: float = 12.0) -> bool:
    tip = cell.kinematics.tip(a + np.linspace(0, 1, 60)[:, None] * (b - a), cell.theta)[0]
    assert cell.jig is not None
    grown = [
        ((tip > np.array(x.lower) - margin) & (tip < np.array(x.upper) + margin)).all(axis=1) for x in cell.jig.boxes
    ]
    return not np.any(grown)


def disturbed(cell: Cell, scale: float = 0.15, seed: int = 5) -> np.ndarray:
    """Parameters of a robot that is off by a part of its tolerances."""
    return cell.theta + scale * cell.scale * np.random.default_rng(seed).standard_normal(len(cell.theta))
