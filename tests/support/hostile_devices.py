"""Controllers in ticking time for the hostile bench: line, GRBL and LinuxCNC semantics before one robot and one jig."""

import re
from typing import Any

import numpy as np
from linuxcncrsh_fake import AXES, FakeLinuxCNC
from touching import Ticks, World
from touching_line import LineServer

from probe.line.controller import LinkLost
from probe.virtual.grbl import GrblController
from probe.virtual.robot import VirtualRobot
from probe.virtual.truth import Truth


class LineDevice(LineServer):
    """TOUCH/1, as the tests of the driver have it."""

    def follow(self) -> None:
        """Let the time pass that has passed."""
        self._pass_time()

    def at(self) -> np.ndarray:
        return self._q()


class GrblDevice:
    """The virtual GRBL at a transport of its own; what it does is told to the world."""

    url = "test://grbl"

    def __init__(self, world: World, clock: Ticks, truth: Truth) -> None:
        self.world, self.clock, self.outbox, self.plugged, self.gone_until = world, clock, b"", True, -1.0
        self.robot = VirtualRobot(world.cell, truth, np.random.default_rng(0), start=world.q)
        self.grbl = GrblController(self.robot, axis_unit_deg=0.1)
        self._noted = self._touched = 0
        self.robot.time = clock.t

    def write(self, data: bytes) -> None:
        self._alive()
        self._say(self.grbl.feed(data, self.clock.t))

    def read(self, timeout: float) -> bytes:
        self._alive()
        until = self.clock.t + timeout
        while not self.outbox and self.clock.t < until:
            self.clock.t = min(until, max(self.grbl.due, self.clock.t + 1e-4))
            self.follow()
        out, self.outbox = self.outbox, b""
        self.clock.t += 0.002 if out else 0.0
        return out

    def reopen(self) -> None:
        if self.clock.t < self.gone_until:
            raise LinkLost("the cable is off")
        self.plugged, self.outbox = True, b""

    def close(self) -> None:
        self.plugged = False

    def reboot(self) -> None:
        self.follow()
        self._say(self.grbl.restart())
        self.note()

    def at(self) -> np.ndarray:
        return self.robot.q

    def follow(self) -> None:
        self.robot.health.stuck = self.world.stuck
        self._say(self.grbl.advance(self.clock.t))

    def _say(self, lines: list[bytes]) -> None:
        self.outbox += b"".join(lines)
        self.note()

    def note(self) -> None:
        world = self.world
        for motion in self.robot.executed[self._noted :]:
            world.motions.append((world.q.copy(), motion.outcome.stop.copy()))
            world.q = motion.outcome.stop.copy()
        world.truth += [touch.q for touch in self.robot.touches[self._touched :]]
        self._noted, self._touched = len(self.robot.executed), len(self.robot.touches)

    def _alive(self) -> None:
        self.follow()
        if not self.plugged:
            raise LinkLost("the cable is off")


class LinuxCNCDevice(FakeLinuxCNC):
    """linuxcncrsh before the world: G38.3 and G1 end where the wire touches."""

    def __init__(self, world: World, clock: Ticks) -> None:
        self.world: Any = None
        super().__init__(clock)
        self.world, self._rest, self.gone_until = world, np.degrees(world.q), -1.0
        self._counted: object = None

    @property
    def closed(self) -> bool:
        return self.world is not None and bool(self.world.stuck or self.world.touching(np.radians(self.position())))

    @closed.setter
    def closed(self, value: bool) -> None:
        """The world knows."""

    def reopen(self) -> None:
        if self.clock.t < self.gone_until:
            raise LinkLost("the cable is off")
        super().reopen()

    def reboot(self) -> None:
        self.restart()
        self.homed, self.open = True, False

    def at(self) -> np.ndarray:
        return np.radians(self.position())

    def follow(self) -> None:
        self.world.q = self.at()

    def _move(self, code: str, words: dict[str, str]) -> None:
        start = self._rest.copy()
        end = np.array([float(words.get(axis, start[i])) for i, axis in enumerate(AXES)])
        began_closed = self.closed
        hit = None if began_closed else self.world.first_contact(np.radians(start), np.radians(end))
        if code == "G38.3" and began_closed:
            self.errors.append("Probe is already tripped when starting G38.2 or G38.3 move")
            return
        self.contact_at = hit if code == "G38.3" else None
        if code == "G38.3" and hit is not None:
            self.world.truth.append(np.radians(start + hit * (end - start)))
        super()._move(code, words)
        if code == "G1" and hit is not None:
            self.trip(hit)

    def _stop(self) -> None:
        before = getattr(self, "_motion", None)
        super()._stop()
        if before is not None and self.world is not None:
            self.world.motions.append((np.radians(before[0]), np.radians(self._rest)))


LINES = re.compile(rb"[^\n]*\n|[^\n]+")
