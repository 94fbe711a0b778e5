"""Controllers in ticking time for the hostile bench: line, GRBL and LinuxCNC semantics before one true robot."""

from typing import Any

import numpy as np
from linuxcncrsh_fake import AXES, FakeLinuxCNC
from touching import Ticks
from touching_line import LineServer, Running
from true_world import TrueWorld

from probe.line.controller import LinkLost
from probe.virtual.grbl import GrblController
from probe.virtual.robot import VirtualRobot
from probe.virtual.truth import Truth

CUT = "the cable is off"
GRBL_CYCLE = 0.002  # [s] from one answer of GRBL to the next


class LineDevice(LineServer):
    """TOUCH/1, as the tests of the driver have it."""

    world: TrueWorld
    guarded = False

    @property
    def moving(self) -> bool:
        return self.running is not None

    def follow(self) -> None:
        """Let the time pass that has passed."""
        self._pass_time()

    def at(self) -> np.ndarray:
        return self._q()

    def press(self) -> None:
        """The input has closed, whatever the wire does: what watches it ends here."""
        self._pass_time()
        run = self.running
        if run is None or not self.guarded:
            return
        fraction = (self.clock.t - run.began) / run.duration
        if fraction < (run.hit if run.hit is not None else 1.0):
            run.hit = run.latched = fraction
            run.stop = min(fraction + (self.world.over / run.duration if run.verb == "SEARCH" else 0.0), 1.0)

    def _execute(self, seq: int, verb: str, rest: list[str]) -> None:
        self.guarded = not self.world.closed
        super()._execute(seq, verb, rest)

    def _settle_at(self, at: float) -> Running | None:
        run = super()._settle_at(at)
        self._note(run, at)
        return run

    def _finish(self, run: Running) -> None:
        super()._finish(run)
        self._note(run, run.began + run.stop * run.duration)

    def _note(self, run: Running | None, ended: float) -> None:
        if run is not None:
            self.world.moved(run.start, self.world.q, run.began, ended, searching=run.verb == "SEARCH")


class GrblDevice:
    """The virtual GRBL at a transport of its own; what its robot does is written down in the world."""

    url = "test://grbl"

    def __init__(
        self, world: TrueWorld, clock: Ticks, truth: Truth, axis_unit_deg: float, quirks: frozenset[str] = frozenset()
    ) -> None:
        self.world, self.clock, self.outbox, self.plugged, self.gone_until = world, clock, b"", True, -1.0
        self.robot = VirtualRobot(world.cell, truth, np.random.default_rng(0), start=world.q)
        self.robot.health.bounce = world.chatter
        surroundings = self.robot.arm.surroundings
        surroundings.boxes, surroundings.shapes = [], ()  # arm and torch are judged elsewhere; here it is the tip
        self.grbl = GrblController(self.robot, axis_unit_deg=axis_unit_deg, quirks=quirks)
        self._noted = 0
        self.robot.time = clock.t

    @property
    def moving(self) -> bool:
        return self.robot.moving

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
        self.clock.t += GRBL_CYCLE if out else 0.0
        return out

    def reopen(self) -> None:
        if self.clock.t < self.gone_until:
            raise LinkLost(CUT)
        self.plugged, self.outbox = True, b""

    def close(self) -> None:
        self.plugged = False

    def reboot(self) -> None:
        self.follow()
        self._say(self.grbl.restart())

    def press(self) -> None:
        self.follow()
        motion = self.robot._motion
        if motion is not None and motion.watch:  # the input closes now, whatever the wire does
            motion.tripped = min(motion.tripped, self.robot.time)

    def at(self) -> np.ndarray:
        return self.robot.q

    def follow(self) -> None:
        self.robot.health.stuck = self.world.is_forced(self.clock.t)
        self._say(self.grbl.advance(self.clock.t))

    def _say(self, lines: list[bytes]) -> None:
        self.outbox += b"".join(lines)
        world = self.world
        for one in self.robot.executed[self._noted :]:
            world.moved(world.q, one.outcome.stop, one.began, one.ended, searching=one.kind == "SEARCH")
        self._noted = len(self.robot.executed)

    def _alive(self) -> None:
        self.follow()
        if not self.plugged:
            raise LinkLost(CUT)


class LinuxCNCDevice(FakeLinuxCNC):
    """linuxcncrsh before the world: G38.3 and G1 end where the wire touches."""

    def __init__(self, world: TrueWorld, clock: Ticks) -> None:
        self.world: Any = None
        super().__init__(clock)
        self.world, self._rest, self.gone_until = world, np.degrees(world.q), -1.0
        self._code, self._guarded, self._contact = "", False, ""  # of the motion that runs

    @property
    def moving(self) -> bool:
        return self._moves()

    @property
    def closed(self) -> bool:
        return self.world is not None and self.world.reads(self.world.touching(self.at()))

    @closed.setter
    def closed(self, value: bool) -> None:
        """The world knows."""

    def reopen(self) -> None:
        if self.clock.t < self.gone_until:
            raise LinkLost(CUT)
        super().reopen()

    def reboot(self) -> None:
        self.restart()
        self.homed, self.open = True, False

    def at(self) -> np.ndarray:
        return np.radians(self.position())

    def follow(self) -> None:
        if self._motion is not None and not self._moves():
            self._stop()

    def press(self) -> None:
        if not self._moves() or not self._guarded:
            return
        assert self._motion is not None
        start, _, begun, _ = self._motion
        elapsed, here = self.clock.t - begun, self.position()
        self._motion = start, here, begun, elapsed
        if self._code == "G38.3":
            self.parameters |= {f"#{5061 + i}": v for i, v in enumerate(here.tolist())} | {"#5070": 1.0}
        elif not self._contact:
            self.errors.append("Probe tripped during non-probe move.")

    def _move(self, code: str, words: dict[str, str]) -> None:
        start = self._rest.copy()
        end = np.array([float(words.get(axis, start[i])) for i, axis in enumerate(AXES)])
        began_closed = self.closed
        if code == "G38.3" and began_closed:
            self.errors.append("Probe is already tripped when starting G38.2 or G38.3 move")
            return
        hit = None if began_closed else self.world.first_contact(np.radians(start), np.radians(end))
        self.contact_at = hit if code == "G38.3" else None
        self._code, self._guarded, self._contact = code, not began_closed, ""
        super()._move(code, words)
        if code == "G1" and hit is not None:
            self.trip(hit)
            self._contact = "of the wire"

    def _stop(self) -> None:
        motion, whole = self._motion, not self._moves()
        super()._stop()
        if motion is None or self.world is None:
            return
        if self._code == "G38.3" and not whole:
            self.parameters["#5070"] = -1.0  # aborted before it met anything
        start, _, begun, seconds = motion
        ended = min(self.clock.t, begun + seconds)
        world, search = self.world, self._code == "G38.3"
        world.moved(np.radians(start), np.radians(self._rest), begun, ended, searching=search)
