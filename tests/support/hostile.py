"""Seeded schedules of everything that can happen on a line and to a controller, and what must hold all the same.

One schedule is one plan of a few touches, driven through as many runs as it takes: lines are spoiled, lost, doubled,
replayed, delayed and cut in half, ports flood and vanish, controllers start anew, the input sticks, the program is
killed or interrupted. The judge knows the robot itself: `World` says where the tip truly is and where the wire touched.
"""

import json
import os
import tempfile
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from hostile_devices import LINES, GrblDevice, LineDevice, LinuxCNCDevice
from touching import Ticks, World, clear_plan, disturbed, pointed

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.description import library, read_cell
from identify.model.io.tables import read_touches
from identify.model.touch import Plan
from probe.controllers.grbl import Grbl
from probe.controllers.line import Line
from probe.controllers.linuxcnc import LinuxCNC
from probe.line.controller import TouchError
from probe.motion.settings import Settings
from probe.runs.execution import run
from probe.runs.session import Session, journal_path
from probe.virtual.truth import Truth, draw_truth, with_effects

BACKENDS = ("line", "grbl", "linuxcnc")
TOUCHES, RUNS = 3, 8
BOUND = 45.0  # [s] of any one call: a motion lasts 25 s at most, and a line that is gone is given up after 10 s
DEEP = 1.2  # [mm] that the tip may enter the jig: a search at 10 mm/s brakes in less
ASTRAY = 0.5  # [mm] off what was commanded
SPOILS = ("flip", "drop byte", "drop", "half", "garbage", "duplicate", "replay", "delay")
# a serial line neither repeats nor reorders what the host sends, and GRBL and linuxcncrsh have no numbers to see it by
TO = {"line": (*SPOILS,), "grbl": ("flip", "drop byte", "drop", "half"), "linuxcnc": ()}
FROM = {"line": SPOILS[:-1], "grbl": SPOILS[:5], "linuxcnc": ()}
EVENTS = ("unplug", "reboot", "stuck", "flood", "kill", "interrupt")


class Killed(BaseException):
    """The program is killed: nothing of it runs any more."""


@dataclass
class Schedule:
    """What happens, by seed."""

    seed: int
    backend: str
    rate: float = 0.0  # of lines spoiled
    events: dict[int, str] = field(default_factory=dict)  # by the number of the transport's call
    happened: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, seed: int, backend: str) -> "Schedule":
        rng = np.random.default_rng([seed, BACKENDS.index(backend)])
        rate = float(rng.choice([0.0, 0.01, 0.05, 0.15]))
        chosen = rng.choice(EVENTS, size=int(rng.integers(1, 5)))
        calls = rng.integers(10, 1500 if backend != "linuxcnc" else 4000, size=len(chosen))
        return cls(seed, backend, rate, {int(n): str(event) for n, event in zip(calls, chosen, strict=True)})


class HostileLine:
    """A transport whose lines suffer, and whose calls may be the last."""

    def __init__(self, device: Any, schedule: Schedule, rng: np.random.Generator, clock: Ticks, world: World) -> None:
        self.device, self.schedule, self.rng, self.clock, self.world = device, schedule, rng, clock, world
        self.url, self.calls, self.quiet = device.url, 0, False
        self.old: dict[int, deque[bytes]] = {}  # lines of each direction, to be replayed
        self.late: list[tuple[float, bytes]] = []
        self.flood_until = -1.0

    def write(self, data: bytes) -> None:
        self._call()
        for line in LINES.findall(data):
            for part in self._spoiled(line, TO[self.schedule.backend]):
                self.device.write(part)

    def read(self, timeout: float) -> bytes:
        self._call()
        if self.clock.t < self.flood_until:
            self.clock.t += 0.001
            self.device.follow()
            return bytes(self.rng.integers(0, 256, 2048, dtype=np.uint8))
        data = self.device.read(timeout)
        return b"".join(b"".join(self._spoiled(line, FROM[self.schedule.backend])) for line in LINES.findall(data))

    def reopen(self) -> None:
        self.device.reopen()

    def close(self) -> None: ...

    def _call(self) -> None:
        self.calls += 1
        due = [data for at, data in self.late if at <= self.clock.t]
        self.late = [(at, data) for at, data in self.late if at > self.clock.t]
        for data in due:
            self.device.write(data)
        event = None if self.quiet else self.schedule.events.pop(self.calls, None)
        if event is None:
            return
        self.schedule.happened.append(f"{event}@{self.calls}")
        match event:
            case "kill":
                raise Killed
            case "interrupt":
                raise KeyboardInterrupt
            case "stuck":
                self.world.stuck = True
            case "reboot":
                self.device.reboot()
            case "flood":
                self.flood_until = self.clock.t + float(self.rng.choice([0.3, 3.0, 20.0]))
            case "unplug":
                self.device.gone_until = self.clock.t + float(self.rng.choice([0.3, 2.0, 20.0]))
                setattr(self.device, "open" if self.schedule.backend == "linuxcnc" else "plugged", False)

    def _spoiled(self, line: bytes, kinds: tuple[str, ...]) -> list[bytes]:
        old = self.old.setdefault(id(kinds), deque(maxlen=20))
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
            case "delay" if self.schedule.backend == "line" and kinds is TO["line"]:
                self.late.append((self.clock.t + float(self.rng.exponential(1.0)), line))
        return []


class Bench:
    """What does not change from schedule to schedule."""

    def __init__(self) -> None:
        self.cell: Cell = pointed(read_cell(library("cells")["arc-welder"]))
        self.plan: Plan = clear_plan(self.cell, TOUCHES)
        self.theta = disturbed(self.cell)
        drawn = draw_truth(self.cell, np.random.default_rng(3), scale=0.15)
        self.truth: Truth = replace(with_effects(drawn, sigma=0.0), theta=self.theta)

    def violations(self, seed: int, backend: str) -> list[str]:
        """What did not hold in one schedule, with what had happened."""
        with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder, unsynced():
            trial = Trial(self, Schedule.of(seed, backend), Path(folder))
            trial.drive()
            return [f"{text} (after {', '.join(trial.schedule.happened) or 'nothing'})" for text in trial.judge()]


class Trial:
    """One schedule."""

    def __init__(self, bench: Bench, schedule: Schedule, folder: Path) -> None:
        self.bench, self.schedule, self.path = bench, schedule, folder / "touches.csv"
        self.clock, rng = Ticks(), np.random.default_rng([schedule.seed, 77])
        self.world = World(bench.cell, bench.theta, self.clock, bench.plan.approach[0])
        self.device = self._device()
        self.line = HostileLine(self.device, schedule, rng, self.clock, self.world)
        self.faults, self.finished = list[str](), False

    def _device(self) -> Any:
        match self.schedule.backend:
            case "line":
                return LineDevice(self.world, self.clock)
            case "grbl":
                return GrblDevice(self.world, self.clock, self.bench.truth)
            case _:
                return LinuxCNCDevice(self.world, self.clock)

    def drive(self) -> None:
        """Run after run, until the plan is done; the last ones over a sound line."""
        for attempt in range(RUNS):
            self.line.quiet = attempt >= RUNS - 4
            self.line.calls = 0 if attempt == 0 else self.line.calls
            began = self.clock.t
            try:
                self._once(Settings(search_speed=10.0, trust_position=attempt > 0, misses=9))
                self.finished = True
                break
            except (TouchError, InputError) as error:
                self.schedule.happened.append(f"{type(error).__name__}: {str(error)[:60]}")
            except KeyboardInterrupt:
                self._still_after_stop()
            except Killed:
                self.schedule.happened.append("killed")
            if self.clock.t - began > 1500:
                self.faults.append(f"a run took {self.clock.t - began:.0f} s")
            self._operator()
        self.device.follow()

    def _once(self, settings: Settings) -> None:
        bench, resume = self.bench, journal_path(self.path).exists()
        with Session(self.path, bench.cell, bench.plan, resume=resume, clock=self.clock) as session:
            controller = self._timed(self._controller())
            controller.connect()
            run(bench.plan, controller, session, settings, clock=self.clock)

    def _controller(self) -> Any:
        robot = self.bench.cell.robot
        match self.schedule.backend:
            case "line":
                return Line(self.line, robot, self.clock)
            case "grbl":
                return Grbl(self.line, robot, self.clock, axis_unit_deg=0.1, unlock=True)
            case _:
                return LinuxCNC(self.line, robot, self.clock, home=True)

    def _timed(self, controller: Any) -> Any:
        """The controller, each of whose calls is timed."""

        def timed(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
            def outlast(*arguments: Any) -> Any:
                began = self.clock.t
                try:
                    return call(*arguments)
                finally:
                    if self.clock.t - began > BOUND:
                        self.faults.append(f"{name} took {self.clock.t - began:.0f} s")

            return outlast

        for name in ("connect", "state", "move", "search", "latch", "stop"):
            setattr(controller, name, timed(name, getattr(controller, name)))
        return controller

    def _still_after_stop(self) -> None:
        """After Ctrl-C the run has stopped the robot: whatever is still on the line moves nothing."""
        here = self.device.at().copy()
        for _ in range(20):
            self.clock.sleep(0.5)
            due, self.line.late = self.line.late, []
            for _, data in due:
                if getattr(self.device, "plugged", True) and getattr(self.device, "open", True):
                    self.device.write(data)
            self.device.follow()
        if np.abs(self.device.at() - here).max() > np.radians(0.01):
            self.faults.append("the robot moved after a stop")

    def _operator(self) -> None:
        """What a person does before the next run: time passes, the cable is back, the input is freed."""
        self.line.flood_until, self.device.gone_until = -1.0, -1.0
        self.clock.sleep(30.0)
        self.device.follow()
        self.world.stuck = False
        if isinstance(self.device, LinuxCNCDevice):
            self.device.estop, self.device.machine, self.device.homed = "OFF", "ON", True
        self.device.reopen()

    def judge(self) -> Iterator[str]:
        """Everything that must hold, by what the world knows."""
        yield from self.faults
        if not self.path.exists():
            return
        rows = [line.split(",") for line in self.path.read_text().splitlines()[1:]]
        if len({row[0] for row in rows}) != len(rows):
            yield "a touch is doubled"
        if any(row[2] == "hit" for row in rows):
            hits = read_touches(self.path, self.bench.cell)
            yield from self._wrong(hits.ids, hits.q)
            yield from self._unevidenced(hits.ids)
        yield from self._motions()

    def _wrong(self, ids: tuple[str, ...], q: np.ndarray) -> Iterator[str]:
        truth = np.array(self.world.truth).reshape(-1, q.shape[1])
        tip = self.bench.cell.kinematics.tip
        for name, each in zip(ids, q, strict=True):
            near = np.linalg.norm(tip(truth, self.bench.theta)[0] - tip(each[None], self.bench.theta)[0], axis=1)
            if not len(near) or near.min() > 0.03:
                yield f"touch {name} lies {near.min() if len(near) else np.inf:.3f} mm from where the wire touched"

    def _unevidenced(self, ids: tuple[str, ...]) -> Iterator[str]:
        seen: dict[str, bool] = {}
        proven: set[str] = set()
        for line in journal_path(self.path).read_text().splitlines():
            record = json.loads(line)
            if record["kind"] == "intent" and record["do"] == "search":
                seen = {place: closed for place, closed in seen.items() if place == "approach"}
            elif record["kind"] == "seen":
                seen[record["at"]] = record["closed"]
            elif record["kind"] == "result":
                if seen == {"approach": False, "contact": True, "retracted": False}:
                    proven.add(record["id"])
                seen = {}
        yield from (f"touch {name} has no evidence" for name in ids if name not in proven)

    def _motions(self) -> Iterator[str]:
        """No motion leads deeper into the jig than braking does, nor away from what was intended."""
        segments = [(np.array(r["start"]), np.array(r["end"])) for r in self._intents()]
        for start, end in self.world.motions:
            depth = self.world.depth(start + np.linspace(0, 1, 40)[:, None] * (end - start))
            if depth.max() > DEEP:
                yield f"the tip was {depth.max():.2f} mm inside the jig"
            elif depth[0] > 0.02 and depth.max() > depth[0] + 0.05:
                yield f"a motion that began in contact led {depth.max() - depth[0]:.2f} mm deeper"
            if segments and (off := self._off(end, segments)) > ASTRAY:
                yield f"the tip was {off:.2f} mm off everything that was intended"

    def _intents(self) -> list[dict[str, Any]]:
        records = [json.loads(line) for line in journal_path(self.path).read_text().splitlines()]
        return [record for record in records if record["kind"] == "intent"]

    def _off(self, q: np.ndarray, segments: list[tuple[np.ndarray, np.ndarray]]) -> float:
        """How far a place is from the nearest intended path [mm], by the tip."""
        a, b = (np.radians(np.stack(ends)) for ends in zip(*segments, strict=True))
        line = b - a
        s = np.clip(((q - a) * line).sum(axis=1) / np.maximum((line**2).sum(axis=1), 1e-18), 0, 1)
        nearest = a + s[:, None] * line
        best = nearest[np.abs(nearest - q).max(axis=1).argmin()]
        tips = self.bench.cell.kinematics.tip(np.stack([q, best]), self.bench.theta)[0]
        return float(np.linalg.norm(tips[0] - tips[1]))


@contextmanager
def unsynced() -> Iterator[None]:
    """No waiting for the disk."""
    original, os.fsync = os.fsync, lambda handle: None
    try:
        yield
    finally:
        os.fsync = original
