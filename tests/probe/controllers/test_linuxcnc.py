"""`touchcal run` against the real LinuxCNC, whose robot is not the nominal one: only its sensor knows where it touches.

Two of them run side by side: one is driven through its own linuxcncrsh, one through a TOUCH/1 bridge of the tests.
"""

import runpy
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from linuxcnc_cell import CELL, COUNT, SPEED, cell_of_the_test, contact, short_plan, true_robot, ways
from linuxcnc_running import BRIDGE, CONFIGURATION, RSH, LinuxCNCRunning, needed, truth

import probe
from identify.model.cell import Cell
from identify.model.io.tables import plan_text, read_touches
from identify.model.touch import Plan
from probe.controllers.linuxcncrsh import Shell
from probe.line.clock import Clock
from probe.line.transport import SerialTransport

pytestmark = pytest.mark.xdist_group("linuxcnc")  # one LinuxCNC for all of them
PORTS = {"linuxcnc": RSH, "line": BRIDGE}
SERVO_STEP = 0.001 * SPEED * 1.3  # [mm] in a servo period; the tip's speed varies along a joint path
TINY = 1e-4  # [mm]: joints are told in six decimals, a millionth of a degree at a metre
TOUCHCAL = [sys.executable, "-c", "import sys; from oed.cli import main; sys.exit(main())"]


@dataclass
class Run:
    """What one LinuxCNC and one run of the plan left."""

    ids: tuple[str, ...]
    latched: np.ndarray  # [rad]
    felt: list[dict[str, list[float]]]  # [deg], by the sensor, a touch an entry
    refusal: tuple[int, str]  # of the unhomed machine
    stood: list[float]  # [deg], after that
    said: tuple[int, str]
    code: int
    leftovers: list[str]


def command(protocol: str, output: str, *options: str) -> list[str]:
    where = ["--port", PORTS[protocol], "--protocol", protocol, "-o", output, "--json", *options]
    return [*TOUCHCAL, "run", "plan.csv", *where]


def kill_after(touches: int, process: subprocess.Popen[str], table: Path) -> None:
    """Let a run make so many touches, and kill it in the next."""
    with process:
        while process.poll() is None and (not table.exists() or table.read_text().count("\n") <= touches):
            time.sleep(0.05)
        time.sleep(0.6)
        process.kill()


def standing() -> list[float]:
    """Where the joints stand [deg]."""
    shell = Shell(SerialTransport(RSH), Clock())
    shell.greet()
    where = shell.numbers("joint_pos")
    shell.transport.close()
    return where


def touched(protocol: str, folder: Path, plan: Plan) -> Run:
    """Start LinuxCNC, be refused, home, make touches, be killed, go on to the last touch, and end LinuxCNC."""
    cell = cell_of_the_test()
    with LinuxCNCRunning(folder, cell, true_robot(cell)) as machine:
        (folder / "cell.yaml").write_text(CELL)
        (folder / "plan.csv").write_text(plan_text(plan, cell.robot))
        refusal, stood = machine.command(command(protocol, "unhomed.csv")), machine.inside(standing)
        if protocol == "line":  # the bridge leaves switching on and homing to the operator
            machine.inside(lambda: probe.open_controller(RSH, "linuxcnc", cell.robot, home=True).close())
        first = command(protocol, "touches.csv", *(["--home"] if protocol == "linuxcnc" else []))
        kill_after(COUNT // 3, machine.begun(first), folder / "touches.csv")
        said = machine.command(command(protocol, "touches.csv", "--resume"))
        touches, felt = read_touches(folder / "touches.csv", cell), machine.felt()
        return Run(touches.ids, touches.q, felt, refusal, stood, said, machine.shut_down(), machine.leftovers())


@pytest.fixture(scope="module")
def plan() -> Plan:
    return short_plan(cell_of_the_test(), COUNT)


@pytest.fixture(scope="module")
def runs(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Run]:
    needed()
    folders = {protocol: tmp_path_factory.mktemp(protocol) for protocol in PORTS}
    with ThreadPoolExecutor() as pool:
        under_way = {protocol: pool.submit(touched, protocol, folder, plan) for protocol, folder in folders.items()}
        return {protocol: run.result() for protocol, run in under_way.items()}


@pytest.fixture(scope="module")
def contacts(plan: Plan) -> np.ndarray:
    """Joints at which the true wire meets the jig, a touch a row [rad]."""
    cell = cell_of_the_test()
    return np.array([contact(cell, true_robot(cell), *search) for search in zip(plan.approach, plan.q, strict=True)])


def sensed(cell: Cell, run: Run) -> np.ndarray:
    """How far the tip travelled at each latch while the sensor looked, reckoned and told [mm]."""
    before, told = (np.radians([touch[when] for touch in run.felt]) for when in ("before", "told"))
    own = np.abs(told - run.latched[:, None]).max(axis=2).argmin(axis=1)  # a touch may have taken two attempts
    return ways(cell, before[own], told[own])


def test_the_sensor_reckons_the_same_wire_as_the_model_in_its_own_way(rng):
    cell = cell_of_the_test()
    theta = cell.theta + cell.scale * rng.standard_normal(len(cell.theta))
    sensor = runpy.run_path(str(CONFIGURATION / "touch_sensor.py"))["Cell"](truth(cell, theta))

    for q in rng.uniform(cell.robot.lower, cell.robot.upper, (20, 6)):
        tip, axis = sensor.wire(q.tolist())
        expected, R = cell.kinematics.tip(q[None], theta)
        assert tip == pytest.approx(expected[0], abs=1e-9)  # [mm]
        assert axis == pytest.approx(R[0, :, 2], abs=1e-12)


@pytest.mark.parametrize("protocol", PORTS)
def test_every_touch_is_made_once_though_the_program_was_killed_on_the_way(runs, plan, protocol):
    assert runs[protocol].said[0] == 0, runs[protocol].said[1]
    assert runs[protocol].ids == plan.ids


@pytest.mark.parametrize("protocol", PORTS)
def test_every_latch_is_true_to_a_servo_period_of_motion_and_the_sensors_own(runs, plan, contacts, protocol):
    cell, run = cell_of_the_test(), runs[protocol]

    late = ways(cell, contacts, run.latched) * np.sign(
        ((run.latched - contacts) * (plan.q - plan.approach)).sum(axis=1)
    )

    assert len(late) == COUNT
    assert (late >= -TINY).all()
    assert (late <= SERVO_STEP + sensed(cell, run) + TINY).all()


def test_both_protocols_latch_the_same_contacts(runs):
    cell = cell_of_the_test()

    apart = ways(cell, runs["linuxcnc"].latched, runs["line"].latched)

    assert (apart <= SERVO_STEP + np.maximum(*(sensed(cell, run) for run in runs.values())) + TINY).all()
    assert np.median(apart) <= SERVO_STEP


def test_the_robot_touches_elsewhere_than_the_nominal_model_expects(contacts, plan):
    cell = cell_of_the_test()

    assert ways(cell, contacts, plan.q).max() > 1.0  # [mm]: nothing above could have been copied from the plan


@pytest.mark.parametrize("protocol", PORTS)
def test_an_unhomed_machine_is_refused_in_one_sentence_and_stands_still(runs, protocol):
    code, said = runs[protocol].refusal

    assert code in (1, 2)
    assert "the machine is not homed" in said
    assert said.strip().count("\n") == 0
    assert runs[protocol].stood == [0.0] * 6  # where LinuxCNC wakes up


@pytest.mark.parametrize("protocol", PORTS)
def test_linuxcnc_ends_by_itself_and_leaves_no_process_behind(runs, protocol):
    assert runs[protocol].code == 0
    assert runs[protocol].leftovers == []
