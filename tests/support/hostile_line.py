"""What happens on the line and to the controller in one schedule of the hostile bench, all of it drawn by its seed."""

import re
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from true_world import TrueWorld

from probe.line.controller import LinkLost

BACKENDS = ("line", "grbl", "linuxcnc")
SPOILS = ("flip", "drop byte", "drop", "half", "garbage", "duplicate", "replay", "delay")
# a serial line neither repeats nor reorders what the host sends, and GRBL and linuxcncrsh have no numbers to see it by
TO = {"line": (*SPOILS,), "grbl": ("flip", "drop byte", "drop", "half"), "linuxcnc": ()}
FROM = {"line": SPOILS[:-1], "grbl": SPOILS[:5], "linuxcnc": ()}
EVENTS = ("unplug", "reboot", "stuck", "flicker", "flood", "hang", "kill", "interrupt")
CALLS = {"line": 500, "grbl": 1500, "linuxcnc": 4000}  # of the transport, among which the events fall
GRBLHAL = frozenset({"late-idle", "same-place", "error-lock", "soft-reset"})  # what it does otherwise than GRBL 1.1
FOREVER = 1e9  # [s]
LINES = re.compile(rb"[^\n]*\n|[^\n]+")


class Killed(BaseException):
    """The program is killed: nothing of it runs any more."""


@dataclass
class Schedule:
    """What happens, by seed."""

    seed: int
    backend: str
    rate: float = 0.0  # of lines spoiled
    hold: float = 0.0  # [s] that the sensing signal stays after the wire left
    chatter: float = 0.0  # [s] of a contact that has just changed
    unit: float = 0.1  # [deg] an axis unit of GRBL
    events: dict[int, str] = field(default_factory=dict)  # by the number of the transport's call
    happened: list[str] = field(default_factory=list)

    @property
    def quirks(self) -> frozenset[str]:
        """Of the GRBL: every second one is a grblHAL, and of these every second one takes tools over by M6 only."""
        return frozenset() if self.seed % 2 else GRBLHAL | ({"tool-change"} if self.seed % 4 else set())

    @classmethod
    def of(cls, seed: int, backend: str) -> "Schedule":
        rng = np.random.default_rng([seed, BACKENDS.index(backend)])
        rate = float(rng.choice([0.0, 0.01, 0.05, 0.15]))
        hold, chatter = float(rng.choice([0.0, 0.3])), float(rng.choice([0.0, 0.02]))
        unit = float(rng.choice([0.1, 1.0]))
        chosen = rng.choice(EVENTS, size=int(rng.integers(1, 5)))
        calls = rng.integers(10, CALLS[backend], size=len(chosen))
        events = {int(n): str(event) for n, event in zip(calls, chosen, strict=True)}
        return cls(seed, backend, rate, hold, chatter, unit, events)


class HostileLine:
    """A transport whose lines suffer, and whose calls may be the last; `quiet` where nothing more happens."""

    def __init__(self, device: Any, schedule: Schedule, world: TrueWorld) -> None:
        self.device, self.schedule, self.world, self.clock = device, schedule, world, world.clock
        self.rng = np.random.default_rng([schedule.seed, 77])
        self.url, self.calls, self.quiet = device.url, 0, False
        self._old: dict[str, deque[bytes]] = {"to": deque(maxlen=20), "from": deque(maxlen=20)}  # to be replayed
        self._late: list[tuple[float, bytes]] = []
        self._flood_until = self._hang_until = -1.0
        self.happened_at = 0.0  # [s], of the last event
        self.voice = ""  # of a port that is beside itself from now on: flood, trickle or mute

    def write(self, data: bytes) -> None:
        self._call()
        lines = [data] if self.schedule.backend == "linuxcnc" else LINES.findall(data)  # over TCP: whole, or not at all
        for line in lines:
            for part in self._spoiled(line, "to", TO[self.schedule.backend]):
                self._send(part)

    def read(self, timeout: float) -> bytes:
        self._call()
        if self.voice in ("trickle", "mute"):
            before = int(self.clock.t)
            self.clock.t += timeout + 1e-3
            self.device.read(0.0)
            return b"<" * (int(self.clock.t) - before if self.voice == "trickle" else 0)
        if self.clock.t < self._flood_until:
            self.clock.t += 0.01
            self.device.follow()
            return self.rng.bytes(2048)
        if self.clock.t < self._hang_until:
            self.clock.t = min(self.clock.t + timeout + 1e-3, self._hang_until)
            self.device.follow()
            return b""
        if self.schedule.backend == "linuxcnc":
            return bytes(self.device.read(timeout))
        lines = LINES.findall(self.device.read(timeout))
        return b"".join(part for line in lines for part in self._spoiled(line, "from", FROM[self.schedule.backend]))

    def reopen(self) -> None:
        self.device.reopen()

    def close(self) -> None: ...

    def deliver(self) -> None:
        """Whatever is still on its way arrives."""
        for at, data in sorted(self._late, key=lambda one: one[0]):
            self.clock.sleep(at - self.clock.t)
            self.device.follow()
            with suppress(LinkLost):
                self.device.write(data)
        self._late = []

    def free(self) -> None:
        """Somebody puts the cable right."""
        self._late, self._flood_until, self._hang_until, self.device.gone_until = [], -1.0, -1.0, -1.0

    def _send(self, data: bytes) -> None:
        if self.clock.t < self._hang_until:
            self._late.append((self._hang_until, data))
        else:
            self.device.write(data)

    def _call(self) -> None:
        self.calls += 1
        if self._late:
            due = [data for at, data in self._late if at <= self.clock.t]
            self._late = [(at, data) for at, data in self._late if at > self.clock.t]
            for data in due:
                self.device.write(data)
        event = None if self.quiet else self.schedule.events.pop(self.calls, None)
        if event is not None:
            self.schedule.happened.append(f"{event}@{self.calls}")
            self.happened_at = self.clock.t
            self._happen(event)

    def _happen(self, event: str) -> None:
        now = self.clock.t
        match event:
            case "mute" | "trickle":
                self.voice = event
            case "deluge":
                self._flood_until = FOREVER
            case "kill":
                raise Killed
            case "interrupt":
                raise KeyboardInterrupt
            case "stuck" | "flicker":
                self.world.force(FOREVER if event == "stuck" else float(self.rng.uniform(0.002, 0.05)))
                self.device.press()
            case "reboot":
                self.device.reboot()
            case "flood":
                self._flood_until = now + float(self.rng.choice([0.3, 3.0, 20.0]))
            case "hang":
                self._hang_until = now + float(self.rng.uniform(0.1, 2.0))
            case "unplug":
                self._late = []
                self.device.gone_until = now + float(self.rng.choice([0.3, 2.0, 20.0]))
                setattr(self.device, "open" if self.schedule.backend == "linuxcnc" else "plugged", False)

    def _spoiled(self, line: bytes, way: str, kinds: tuple[str, ...]) -> list[bytes]:
        old = self._old[way]
        old.append(line)
        if self.quiet or not kinds or self.rng.random() >= self.schedule.rate:
            return [line]
        at, kind = int(self.rng.integers(len(line))), str(self.rng.choice(kinds))
        match kind:
            case "flip":
                return [line[:at] + bytes([line[at] ^ 1 << int(self.rng.integers(8))]) + line[at + 1 :]]
            case "drop byte":
                return [line[:at] + line[at + 1 :]]
            case "half":
                return [line[:at]]
            case "garbage":
                return [self.rng.bytes(int(self.rng.integers(1, 40))), line]
            case "duplicate":
                return [line, line]
            case "replay":
                return [old[int(self.rng.integers(len(old)))], line]
            case "delay":
                self._late.append((self.clock.t + float(self.rng.exponential(1.0)), line))
        return []
