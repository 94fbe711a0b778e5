"""Seeded schedules of everything that can happen on a line and to a controller, and what must hold all the same.

One schedule is one plan of a few touches, driven through as many runs as it takes: lines are spoiled, lost, doubled,
replayed, delayed and cut in half, ports flood, hang and vanish, controllers start anew, the input sticks and flickers,
the program is killed or interrupted. `hostile_oracle` judges by where the tip truly was. Time is virtual, and a seed
gives the same schedule wherever it runs: nothing waits, nothing is random but by the seed.
"""

import os
import random
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from hostile_devices import GrblDevice, LineDevice, LinuxCNCDevice
from hostile_kept import KeptPredictor, KeptRoom
from hostile_line import BACKENDS as BACKENDS
from hostile_line import HostileLine, Killed, Schedule
from hostile_oracle import Oracle
from touching import Ticks, clear_plan, disturbed, pointed
from true_world import TrueWorld
from virtual_support import with_effects

from identify.model.cell import Cell
from identify.model.compiled import batch
from identify.model.files import InputError
from identify.model.io.description import library, read_cell
from identify.model.kinematics import Kinematics
from identify.model.touch import Plan
from probe.controllers.grbl import Grbl
from probe.controllers.line import Line
from probe.controllers.linuxcnc import LinuxCNC
from probe.line.controller import TouchError
from probe.motion.joint_path import reach
from probe.motion.settings import Settings
from probe.runs import execution, retreat
from probe.runs.preflight import validate
from probe.runs.session import Session, journal_path
from probe.virtual import arm
from probe.virtual.truth import Truth, draw_truth

TOUCHES, RUNS, SOUND = 3, 8, 4  # SOUND: of the runs, the last ones over a line that does nothing
LONGEST = 1500.0  # [s] of a run


class Bench:
    """What does not change from schedule to schedule; whatever is expensive and only depends on that is kept."""

    def __init__(self) -> None:
        self.cell: Cell = pointed(read_cell(library("cells")["arc-welder"]))
        self.plan: Plan = clear_plan(self.cell, TOUCHES)
        self.reach = reach(self.cell, self.plan)
        self.theta = disturbed(self.cell)
        drawn = draw_truth(self.cell, np.random.default_rng(3), scale=0.15)
        self.truth: Truth = replace(with_effects(drawn, sigma=0.0), theta=self.theta)
        self._validated = cache(lambda settings, joints: validate(self.plan, self.cell, settings, joints))
        self._kinematics = cache(Kinematics)

    def violations(self, seed: int, backend: str) -> list[str]:
        """What did not hold in one schedule, with what had happened."""
        trial = self.trial(seed, backend)
        return [f"{text} (after {', '.join(trial.schedule.happened) or 'nothing'})" for text in trial.found]

    def trial(self, seed: int, backend: str) -> "Trial":
        """One schedule, driven and judged."""
        folder = "/dev/shm" if Path("/dev/shm").is_dir() else None
        with tempfile.TemporaryDirectory(dir=folder) as name, self.still(seed):
            trial = Trial(self, Schedule.of(seed, backend), Path(name))
            trial.drive()
            trial.judge()
            return trial

    @contextmanager
    def still(self, seed: int) -> Iterator[None]:
        """No waiting for the disk, no chance but the seed's, no work that was done in an earlier schedule."""
        chance = random.Random(seed)

        def validated(plan: Plan, cell: Cell, settings: Settings, joints: int) -> Any:
            return self._validated(settings, joints)

        with (
            patch.object(os, "fsync", lambda handle: None),
            patch.object(secrets, "token_hex", lambda size: chance.randbytes(size).hex()),
            patch.object(secrets, "randbelow", chance.randrange),
            patch.object(execution, "validate", validated),
            patch.object(execution, "Predictor", KeptPredictor),
            patch.object(retreat, "Room", KeptRoom),
            patch.object(arm, "Kinematics", self._kinematics),
            patch.multiple(batch, WORTH=0, OWN=0),  # one way to evaluate, however often it was done before
        ):
            yield


class Trial:
    """One schedule."""

    def __init__(self, bench: Bench, schedule: Schedule, folder: Path) -> None:
        self.bench, self.schedule, self.path = bench, schedule, folder / "touches.csv"
        self.clock = Ticks()
        self.world = TrueWorld(bench.cell, bench.theta, self.clock, bench.plan.approach[0])
        self.world.hold, self.world.chatter = schedule.hold, schedule.chatter
        self.device = self._device()
        self.line = HostileLine(self.device, schedule, self.world)
        self.oracle = Oracle(self.world, bench.cell, bench.plan, self.device)
        self.finished, self.found, self.journal = False, list[str](), b""

    def _device(self) -> Any:
        match self.schedule.backend:
            case "line":
                return LineDevice(self.world, self.clock)
            case "grbl":
                return GrblDevice(self.world, self.clock, self.bench.truth, self.schedule.unit, self.schedule.quirks)
            case _:
                return LinuxCNCDevice(self.world, self.clock)

    def drive(self) -> None:
        """Run after run, until the plan is done; the last ones over a sound line."""
        for attempt in range(RUNS):
            self.line.quiet = attempt >= RUNS - SOUND
            began = self.clock.t
            try:
                self.once(Settings(search_speed=10.0, trust_position=attempt > 0, misses=9))
                self.finished = True
                break
            except (TouchError, InputError) as error:
                self.schedule.happened.append(f"{type(error).__name__}: {str(error)[:60]}")
                self._deliver("an error")
            except KeyboardInterrupt:
                self._deliver("a stop")
            except Killed:
                self.schedule.happened.append("killed")
            if self.clock.t - began > LONGEST:
                self.oracle.faults.append(f"a run took {self.clock.t - began:.0f} s")
            self._operator()

    def judge(self) -> None:
        """Find what did not hold."""
        if not self.finished:
            self.oracle.faults.append(f"the plan was not done in {SOUND} runs over a sound line")
        self.found = list(self.oracle.violations(self.path, journal_path(self.path)))
        self.journal = journal_path(self.path).read_bytes()

    def once(self, settings: Settings) -> None:
        """One run."""
        bench, resume = self.bench, journal_path(self.path).exists()
        with Session(self.path, bench.cell, bench.plan, resume=resume, clock=self.clock) as session:
            controller = self.oracle.watch(self._controller())
            controller.connect()
            execution.run(bench.plan, controller, session, settings, clock=self.clock)

    def _controller(self) -> Any:
        robot = self.bench.cell.robot
        match self.schedule.backend:
            case "line":
                return Line(self.line, robot, self.clock)
            case "grbl":
                unit, near = self.schedule.unit, self.bench.reach
                return Grbl(self.line, robot, self.clock, axis_unit_deg=unit, reach=near, unlock=True)
            case _:
                return LinuxCNC(self.line, robot, self.clock, home=True)

    def _deliver(self, after: str) -> None:
        """The run is over: whatever is still on the line begins nothing."""
        self.line.deliver()
        if after == "a stop":
            self.oracle.expect_rest(10.0, after)

    def _operator(self) -> None:
        """What a person does before the next run: time passes, the cable is back, the input is freed."""
        self.line.free()
        self.clock.sleep(30.0)
        self.device.follow()
        self.world.release()
        if isinstance(self.device, LinuxCNCDevice):
            self.device.estop, self.device.machine, self.device.homed = "OFF", "ON", True
        self.device.reopen()
