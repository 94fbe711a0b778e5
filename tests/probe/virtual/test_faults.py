"""Every fault, alone and at random, on a virtual cell behind a real port: each touch right, each rejection with its
reason, every command executed once; and a driver that is killed again and again.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import touch_run
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from sessions import rebuilt
from touch_run import OPTIONS, TOUCHES
from touching import clear_plan, pointed
from virtual_support import with_effects

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.controllers import open_controller
from probe.line.clock import Clock
from probe.line.controller import Controller, Rebooted, TouchError
from probe.motion.joint_path import Geometry
from probe.motion.settings import Settings
from probe.runs import events
from probe.runs.execution import run
from probe.runs.records import Result
from probe.runs.session import Session, journal_path
from probe.virtual.server import VirtualCell, serve
from probe.virtual.truth import Truth, draw_truth

KILLS = int(os.environ.get("TOUCHCAL_KILLS", "18"))
USUAL = Settings(search_speed=10.0, rest=0.02)  # the rest is of real time, while that of the robot jumps
AS_FAST_AS_POSSIBLE = float("inf")
SERVO = 0.001  # [s]


@pytest.fixture(scope="module")
def cell(arc_welder: Cell) -> Cell:
    return pointed(arc_welder)


@pytest.fixture(scope="module")
def plan(cell: Cell) -> Plan:
    return clear_plan(cell, TOUCHES)


@pytest.fixture(scope="module")
def truth(cell: Cell) -> Truth:
    return with_effects(draw_truth(cell, np.random.default_rng(3), scale=0.15), sigma=0.0, servo=SERVO)


@dataclass
class Bench:
    """A virtual cell, a session, and what was told."""

    served: VirtualCell
    controller: Controller
    cell: Cell
    plan: Plan
    path: Path
    told: list[events.Event] = field(default_factory=list)
    results: dict[str, Result] = field(default_factory=dict)

    def run(self, settings: Settings = USUAL, controller: Controller | None = None) -> events.Finished:
        resume = journal_path(self.path).exists()
        with Session(self.path, self.cell, self.plan, resume=resume) as session:
            try:
                return run(self.plan, controller or self.controller, session, settings, tell=self.told.append)
            finally:
                self.results = dict(session.results)

    def reasons(self) -> list[str]:
        return [event.reason for event in self.told if isinstance(event, events.Retried)]

    def check_touches(self, rounding: float = 2e-6) -> None:
        """Every accepted touch is a contact that truly happened, on the face it names, right to the servo step."""
        for result in self.results.values():
            if result.status != "hit":
                continue
            near = min(self.served.robot.touches, key=lambda true: np.abs(true.q - result.reading.q).max())
            step = np.degrees(np.abs(result.reading.velocity).max()) * SERVO
            assert np.degrees(np.abs(near.q - result.reading.q).max()) <= step + rounding
            assert near.surface == result.face

    def check_commands(self) -> None:
        """Commands count up by one within a start of the controller, and each motion was made once."""
        commands = self.served.controller.commands  # type: ignore[attr-defined]
        numbers = [number for boot, number, _ in commands if boot == commands[0][0]]
        assert numbers == list(range(1, len(numbers) + 1))
        assert len(self.served.robot.executed) <= len(commands)


@contextmanager
def bench_of(
    cell: Cell, plan: Plan, truth: Truth, folder: Path, *faults: str, protocol: str = "line", seed: int = 1
) -> Iterator[Bench]:
    options = OPTIONS[protocol]
    with serve(
        cell,
        truth,
        protocol=protocol,
        speed=AS_FAST_AS_POSSIBLE,
        start=plan.approach[0],
        faults=faults,
        seed=seed,
        **options,
    ) as served:
        clock = Clock(robot=served.clock.now)  # the robot's time jumps
        controller = open_controller(served.url, protocol, cell.robot, clock=clock, **options)
        try:
            yield Bench(served, controller, cell, plan, folder / "touches.csv")
        finally:
            controller.close()


ALONE = {  # a fault, and the words with which a touch is rejected for it; none where the line mends it by itself
    "bit-flip:0.05": "",
    "lost-byte:0.05": "",
    "garbage:0.05": "",
    "duplicate:0.05": "",
    "lost-line:0.05": "",
    "spoil:0.05": "",
    "unplug@3,seconds=0.2": "",
    "unplug@3,seconds=2": "heard nothing from here",
    "hang@2": "heard nothing from here",
    "stuck@4,seconds=1": "",
    "open@5,for=2": "nothing met within 60.0 mm",
    "bounce@3": "the contact did not last",  # where the look at the contact falls into the chatter
    "stall@4": "the drives stopped",
    "early@2": "",  # on the way off the face: back a little, and on
    "early@5": "touched something during a move",
}


@pytest.mark.ghost  # a wire that feels nothing lets the torch go on into the jig, on the search too
@pytest.mark.parametrize("fault", ALONE)
def test_the_driver_outlives_a_fault_and_every_touch_is_right(
    cell: Cell, plan: Plan, truth: Truth, tmp_path: Path, fault: str
) -> None:
    with bench_of(cell, plan, truth, tmp_path, fault) as bench:
        finished = bench.run()

        assert finished.hits == len(plan)
        assert bench.served.faults.happened
        assert all(ALONE[fault] in reason for reason in bench.reasons())
        assert fault == "bounce@3" or bool(bench.reasons()) == bool(ALONE[fault])
        bench.check_touches()
        bench.check_commands()
        assert bench.path.read_text() == rebuilt(journal_path(bench.path))


@pytest.mark.parametrize("fraction", [0.1, 0.9, 1.0, 1.5])
@pytest.mark.parametrize("kind", ["reboot", "reboot-lost"])
def test_after_a_restart_nothing_moves_until_the_operator_agrees(
    cell: Cell, plan: Plan, truth: Truth, tmp_path: Path, kind: str, fraction: float
) -> None:
    with bench_of(cell, plan, truth, tmp_path, f"{kind}@3,fraction={fraction}") as bench:
        with pytest.raises(Rebooted):
            bench.run()
        executed = len(bench.served.robot.executed)
        with pytest.raises(Rebooted):
            bench.run()
        with bench.served.lock:
            assert len(bench.served.robot.executed) == executed
            bench.served.robot.home()

        finished = bench.run(replace(USUAL, trust_position=True))

        assert finished.hits == len(plan)
        bench.check_touches()


def test_an_input_that_is_stuck_stops_the_run_and_once_free_no_touch_is_missing(
    cell: Cell, plan: Plan, truth: Truth, tmp_path: Path
) -> None:
    with bench_of(cell, plan, truth, tmp_path, "stuck@4") as bench:
        with pytest.raises(TouchError, match="still closed"):
            bench.run()
        assert len(bench.results) == 3
        with bench.served.lock:
            bench.served.robot.health.stuck = False

        assert bench.run().hits == len(plan)
        assert len(bench.served.robot.touches) == len(plan) + 1  # nobody saw the fourth one open: it is made again
        bench.check_touches()


@pytest.mark.ghost  # a wire that feels nothing lets the torch go on into the jig, on the search too
def test_a_broken_wire_ends_the_run_after_three_touches(cell: Cell, plan: Plan, truth: Truth, tmp_path: Path) -> None:
    with bench_of(cell, plan, truth, tmp_path, "open@3,for=30") as bench:
        with pytest.raises(TouchError, match="3 touches in a row failed"):
            bench.run()

        assert [result.status for result in bench.results.values()] == ["hit"] * 2 + ["miss"] * 3


def test_the_emergency_stop_is_the_end_until_it_is_released(
    cell: Cell, plan: Plan, truth: Truth, tmp_path: Path
) -> None:
    with bench_of(cell, plan, truth, tmp_path, "estop@4") as bench:
        with pytest.raises(TouchError, match="emergency stop"):
            bench.run()
        with pytest.raises(TouchError, match="emergency stop"):
            bench.run()
        with bench.served.lock:
            bench.served.robot.health.estop = False

        assert bench.run().hits == len(plan)
        bench.check_touches()


def test_an_unhomed_machine_is_told_from_a_homed_one_before_it_moves(
    cell: Cell, plan: Plan, truth: Truth, tmp_path: Path
) -> None:
    with bench_of(cell, plan, truth, tmp_path) as bench:
        bench.served.robot.health.homed = False
        with pytest.raises(TouchError, match="not homed"):
            bench.run()
        assert bench.served.robot.executed == []
        bench.served.robot.health.homed = True

        assert bench.run().hits == len(plan)


MISHAPS = ["unplug", "hang", "stall", "bounce", "open", "stuck", "early", "reboot", "estop"]


@pytest.mark.ghost  # a wire that feels nothing lets the torch go on into the jig, on the search too
@settings(max_examples=8, phases=[Phase.explicit, Phase.generate])  # it waits for real time: no shrinking
@given(st.lists(st.tuples(st.sampled_from(MISHAPS), st.integers(2, 10)), max_size=4), st.integers(0, 10**6))
def test_any_sequence_of_faults_leaves_only_true_touches_and_loses_none(
    cell: Cell,
    plan: Plan,
    truth: Truth,
    tmp_path_factory: pytest.TempPathFactory,
    mishaps: list[tuple[str, int]],
    seed: int,
) -> None:
    seconds = {"unplug": ",seconds=0.6", "hang": ",seconds=1.2", "stuck": ",seconds=1", "estop": ",seconds=1"}
    faults = [f"{kind}@{at}{seconds.get(kind, '')}" for kind, at in mishaps]
    folder = tmp_path_factory.mktemp("faults")

    with bench_of(cell, plan, truth, folder, "spoil:0.05", *faults, seed=seed) as bench:
        for _ in range(2 * len(mishaps) + 2):  # what an operator does: puts it right, and goes on
            try:
                bench.run(replace(USUAL, trust_position=True, misses=12))
            except TouchError:
                with bench.served.lock:
                    bench.served.robot.health.estop = False
                continue
            break

        assert list(bench.results) == list(plan.ids)
        assert sum(result.status == "hit" for result in bench.results.values()) >= len(plan) - len(mishaps)
        bench.check_touches()
        assert bench.path.read_text() == rebuilt(journal_path(bench.path))


@pytest.mark.parametrize("fault", ["unplug@3,seconds=2", "hang@2", "stuck@4,seconds=1", "bounce@3", "spoil:0.01"])
def test_grbl_outlives_what_it_can_notice(cell: Cell, plan: Plan, truth: Truth, tmp_path: Path, fault: str) -> None:
    with bench_of(cell, plan, truth, tmp_path, fault, protocol="grbl") as bench:
        finished = bench.run()

        assert finished.hits >= len(plan) - (fault == "spoil:0.01")
        bench.check_touches(rounding=0.5e-4 + 2e-6)  # three decimals of a tenth of a degree
        assert bench.served.controller.settings_written == 0  # type: ignore[attr-defined]


class Killable:
    """A driver in a process of its own, killed and started again."""

    def __init__(self) -> None:
        command = [sys.executable, str(Path(touch_run.__file__))]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._heard() == "ready"

    def _heard(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def run(self, port: str, protocol: str, folder: Path, scale: float, kill_after: float | None) -> None:
        """One run, killed after some seconds where they are given."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{port} {protocol} {folder} {scale}\n")
        self.process.stdin.flush()
        child = int(self._heard())
        if kill_after is not None:
            time.sleep(kill_after)
            with suppress(ProcessLookupError):  # it was faster
                os.kill(child, signal.SIGKILL)
        assert self._heard() == "ended"


@pytest.fixture
def driver() -> Iterator[Killable]:
    killable = Killable()
    yield killable
    killable.process.communicate()


@pytest.mark.parametrize(
    ("protocol", "speed", "deadman", "longest"),
    [
        ("line", AS_FAST_AS_POSSIBLE, None, 0.35),
        ("line", 20.0, 6.0, 0.6),  # 6 s are 0.3 s on the wall: motions are cut short, too
        ("grbl", AS_FAST_AS_POSSIBLE, None, 0.6),
    ],
)
def test_a_driver_killed_at_any_moment_loses_and_doubles_nothing_and_the_robot_only_goes_back(
    cell: Cell,
    plan: Plan,
    truth: Truth,
    tmp_path: Path,
    driver: Killable,
    protocol: str,
    speed: float,
    deadman: float | None,
    longest: float,
) -> None:
    rng, kills = np.random.default_rng(11), 0
    scale = 1.0 if speed == AS_FAST_AS_POSSIBLE else speed
    served_as = {"protocol": protocol, "speed": speed, "deadman": deadman, **OPTIONS[protocol]}

    while kills < KILLS // 3:
        folder = tmp_path / str(kills)
        folder.mkdir()
        with serve(cell, truth, start=plan.approach[0], **served_as) as served:
            while not (folder / "done").exists():
                kills += 1
                after = rng.uniform(0.01, longest) if kills % 20 else None
                driver.run(served.url, protocol, folder, scale, after)
        check_nothing_lost(folder / "touches.csv", cell, plan, served, np.radians(1e-4) if protocol == "grbl" else 1e-7)
        if protocol == "line":  # a GRBL is guarded on its moves by searching, which are told apart no more
            check_only_back(cell, plan, served)


def check_nothing_lost(path: Path, cell: Cell, plan: Plan, served: VirtualCell, rounding: float) -> None:
    assert [line.split(",")[0] for line in path.read_text().splitlines()[1:]] == list(plan.ids)
    assert path.read_text() == rebuilt(journal_path(path))
    with Session(path, cell, plan, resume=True) as session:
        assert len(session.hits()) == len(plan)
        for result in session.hits():
            off = min(np.abs(true.q - result.reading.q).max() for true in served.robot.touches)
            assert off <= np.abs(result.reading.velocity).max() * SERVO + rounding


def check_only_back(cell: Cell, plan: Plan, served: VirtualCell) -> None:
    """After a search, or a move that was cut short, the next motion leads back to an approach, its own where it has.

    Only who has arrived goes on: to another approach, over a posture on the way there, down a line, or into a search.
    """
    geometry = Geometry(cell, USUAL)
    assert cell.jig is not None
    ends = np.array([geometry.target(plan, i, cell.jig).end for i in range(len(plan))])
    here = plan.approach[0]
    for before, after in pairwise(served.robot.executed):
        if before.kind == "SEARCH":
            i = int(np.abs(ends - before.q).max(axis=1).argmin())
            assert after.kind == "MOVE"
            assert np.abs(after.q - plan.approach[i]).max() < 1e-6
        else:
            arrived = np.abs(before.outcome.stop - before.q).max() < np.radians(0.02)
            here = before.q if arrived else here
            goes_back = np.abs(np.vstack([plan.approach, here]) - after.q).max(axis=1).min() < 1e-6
            assert arrived or goes_back
