"""A virtual cell behind a real port: bytes, faults, a controller and a robot, in one thread."""

import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from probe.virtual.faults import Fault, Faults, parse_fault
from probe.virtual.grbl import GrblController
from probe.virtual.line import DEADMAN, LineController
from probe.virtual.log import Log
from probe.virtual.ports import Port, open_port
from probe.virtual.robot import VirtualRobot
from probe.virtual.truth import Truth

IDLE = 0.05  # [s], longest wait for bytes
BITS = 10  # a byte on the line: start, eight, stop


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

    def go_back(self, to: float) -> None:
        """Undo the time since a moment: a real arm need not work out what it meets."""
        self._skipped -= self.now() - to

    def wait(self, until: float) -> float:
        """The host's time [s] from now to a controller time."""
        return max(0.0, (until - self.now()) / self.speed)


class ServedController(Protocol):
    """A controller as the server sees it."""

    robot: VirtualRobot

    @property
    def due(self) -> float:
        """When it does something next by itself [s]."""
        ...

    def feed(self, data: bytes, now: float) -> list[bytes]:
        """Bytes have come; the lines that answer them."""
        ...

    def advance(self, now: float) -> list[bytes]:
        """Let time pass; the lines sent meanwhile."""
        ...

    def restart(self, *, keeps_position: bool = True) -> list[bytes]:
        """Start anew; the lines sent at once."""
        ...

    def excuse(self, until: float) -> None:
        """Forgive the host its silence until a time."""
        ...


class VirtualCell:
    """One virtual cell being served; `robot`, `controller` and `faults` may be looked into under `lock`.

    A deadman counts controller time. Faster than real time, a host that counts its own seconds could not keep it fed,
    so the deadman is that much longer, unless it is given.
    """

    def __init__(
        self,
        cell: Cell,
        truth: Truth,
        *,
        protocol: str = "line",
        port: str = "pty",
        faults: Iterable[Fault | str] = (),
        seed: int = 0,
        speed: float = 1.0,
        start: Float[np.ndarray, " joints"] | None = None,
        deadman: float | None = None,
        baud: int | None = None,
        log: Path | None = None,
        axis_unit_deg: float = 1.0,
    ) -> None:
        robot_rng, line_rng, fault_rng = np.random.default_rng(seed).spawn(3)
        self.clock, self.lock = Clock(speed), threading.RLock()
        self.robot = VirtualRobot(cell, truth, robot_rng, start=start)
        self.controller: ServedController
        if protocol == "line":
            patience = DEADMAN * self.clock.speed if deadman is None and self.clock.speed > 1 else deadman or DEADMAN
            self.controller = LineController(self.robot, line_rng, deadman=patience)
        elif protocol == "grbl":
            self.controller = GrblController(self.robot, axis_unit_deg=axis_unit_deg)
        else:
            raise ValueError(f"protocol '{protocol}' is unknown; the virtual cell speaks line and grbl")
        ordered = [parse_fault(fault) if isinstance(fault, str) else fault for fault in faults]
        self.faults = Faults(ordered, fault_rng)
        self.baud = baud
        self.port: Port = open_port(port)
        self.url = self.port.url
        self.heard: list[bytes] = []  # what came from the host, before faults
        self.said: list[bytes] = []  # what was sent to the host, before faults
        self.error: BaseException | None = None
        self._timers: list[tuple[float, int, Any]] = []
        self._order_of_timers = count()
        self._plugged, self._deaf, self._began = True, False, 0
        self._log = Log(log, self.robot) if log else None
        self._stopping = threading.Event()

    def run(self) -> None:
        """Serve until `stop`."""
        try:
            while not self._stopping.is_set():
                self.turn()
        except BaseException as error:
            self.error = error
            raise
        finally:
            self.port.close()
            if self._log is not None:
                self._log.close()

    def stop(self) -> None:
        """Let `run` return."""
        self._stopping.set()

    def turn(self) -> None:
        """One round: what is due, then what has come."""
        with self.lock:
            self._pass(self.clock.now())
            wait = 0.0 if self._may_jump() else min(self.clock.wait(self._due()), IDLE)
        data = self.port.read(wait)
        with self.lock:
            if data:
                self._take(data)
            elif self._may_jump():
                self._jump()

    def _due(self) -> float:
        return min([self.controller.due, *(timer[0] for timer in self._timers[:1])])

    def _may_jump(self) -> bool:
        return self.clock.jumps and self.robot.moving

    def _jump(self) -> None:
        """Nobody speaks while the robot moves: on to what happens next, the deadman asleep if the line is whole."""
        if self._plugged and not self._deaf:
            self.controller.excuse(min([self.robot.due, *(timer[0] for timer in self._timers[:1])]))
        self.clock.jump(self._due())
        self._pass(self.clock.now())

    def _pass(self, now: float) -> None:
        """Let controller time pass, mishaps in their turn."""
        while self._timers and self._timers[0][0] <= now:
            at, _, action = self._timers.pop(0)
            self._say(self.controller.advance(at))
            self._noted()
            action()
        self._say(self.controller.advance(now))
        self._noted()

    def _take(self, data: bytes) -> None:
        self._pace(data)
        self.heard.append(data)
        for part in self.faults.lines(data, "in"):
            if not self._deaf:
                now = self.clock.now()
                lines = self.controller.feed(part, now)
                self.clock.go_back(now)
                self._say(lines)
            self._noted()

    def _say(self, lines: list[bytes]) -> None:
        for line in lines:
            if self._deaf or not self._plugged:
                continue
            self.said.append(line)
            for part in self.faults.lines(line, "out"):
                self._pace(part)
                self.port.write(part)

    def _pace(self, data: bytes) -> None:
        if self.baud and not self.clock.jumps:
            time.sleep(len(data) * BITS / self.baud / self.clock.speed)

    def _noted(self) -> None:
        """See to the faults of a motion that has begun, and to the log."""
        if self.robot.begun != self._began:
            self._began = self.robot.begun
            self._mend()
            begins, ends = self.robot.expected
            for fault in self.faults.motion(self.robot.kind):
                self._order(fault, begins + fault.fraction * (ends - begins))
        if self._log is not None:
            self._log.write()

    def _mend(self) -> None:
        """An ordered broken wire or bounce lasts until the next search."""
        if self.robot.kind == "SEARCH":
            kinds = {kind for kind, _, _ in self.faults.happened}
            self.robot.health.open &= "open" not in kinds
            self.robot.health.bounce = None if "bounce" in kinds else self.robot.health.bounce
            self.robot.foresee()

    def at(self, moment: float, action: Any) -> None:
        """Do something at a controller time [s]."""
        self._timers.append((moment, next(self._order_of_timers), action))
        self._timers.sort(key=lambda timer: timer[:2])

    def _order(self, fault: Fault, moment: float) -> None:
        health, robot = self.robot.health, self.robot
        after = moment + fault.seconds
        match fault.kind:
            case "unplug":
                self.at(moment, self.unplug)
                self.at(after, self.plug)
            case "reboot" | "reboot-lost":
                self.at(moment, lambda: self.reboot(keeps_position=fault.kind == "reboot", seconds=fault.seconds))
            case "hang":
                self.at(moment, lambda: self._hang(fault.seconds))
            case "estop":
                self.at(moment, lambda: self._press())
                self.at(after, lambda: setattr(health, "estop", False))
            case "stall":
                self.at(moment, lambda: robot.stop("NOTREACHED", "the drives stopped"))
            case "stuck":
                ends = robot.expected[1]
                self.at(ends, lambda: setattr(health, "stuck", True))
                self.at(ends + fault.seconds, lambda: setattr(health, "stuck", False))
            case "open":
                health.open = True
                robot.foresee()
            case "bounce":
                health.bounce = fault.seconds
            case "early":
                robot.obstruct(fault.fraction)

    def unplug(self) -> None:
        """Pull the cable."""
        self._plugged = False
        self.port.unplug()

    def plug(self) -> None:
        """Put the cable back."""
        self.port.plug()
        self._plugged = True

    def reboot(self, *, keeps_position: bool = True, seconds: float = 0.0) -> None:
        """Start the controller anew; it is deaf and mute until it has booted."""
        self._deaf = True
        self.controller.advance(self.clock.now())
        report = self.controller.restart(keeps_position=keeps_position)

        def booted() -> None:
            self._deaf = False
            self._say(report)

        self.at(self.clock.now() + seconds, booted)

    def _hang(self, seconds: float) -> None:
        self._deaf = True
        self.at(self.clock.now() + seconds, lambda: setattr(self, "_deaf", False))

    def _press(self) -> None:
        self.robot.health.estop = True
        self.robot.stop("ESTOP", "the emergency stop was pressed")


@contextmanager
def serve(cell: Cell, truth: Truth, **options: Any) -> Iterator[VirtualCell]:
    """Serve a virtual cell in a thread; its `url` can be opened inside the block. Options: see VirtualCell."""
    served = VirtualCell(cell, truth, **options)
    thread = threading.Thread(target=served.run, name="virtual-cell", daemon=True)
    thread.start()
    try:
        yield served
    finally:
        served.stop()
        thread.join(timeout=10)
    if served.error is not None:
        raise RuntimeError("the virtual cell failed") from served.error
