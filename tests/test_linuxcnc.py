"""`touchcal run` against the real LinuxCNC, whose robot is not the nominal one: only its sensor knows where it touches.

Two of them run side by side: one is driven through its own linuxcncrsh, one through a TOUCH/1 bridge of the tests.
"""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from linuxcnc_cell import CELL, COUNT, SPEED, cell_of_the_test, contact, short_plan, true_robot, ways
from linuxcnc_running import BRIDGE, RSH, LinuxCNCRunning, needed

import probe
from identify.model.cell import Cell
from identify.model.tables import plan_text, read_touches
from identify.model.touch import Plan

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
    moved: float  # [rad], by then
    said: tuple[int, str]
    code: int
    leftovers: list[str]


def touched(protocol: str, folder: Path, plan: Plan) -> Run:
    """Start LinuxCNC, be refused, home, make every touch of a plan, and end LinuxCNC."""
    cell = cell_of_the_test()
    with LinuxCNCRunning(folder, cell, true_robot(cell)) as machine:
        (folder / "cell.yaml").write_text(CELL)
        (folder / "plan.csv").write_text(plan_text(plan, cell.robot))

        def run(output: str, *options: str) -> tuple[int, str]:
            where = ["run", "plan.csv", "--port", PORTS[protocol], "--protocol", protocol, "-o", output, "--json"]
            return machine.command([*TOUCHCAL, *where, *options])

        def home() -> np.ndarray:
            operator = probe.open_controller(RSH, "linuxcnc", cell.robot, home=True)
            where = operator.state().q
            operator.close()
            return where

        refusal = run("unhomed.csv")
        moved = float(np.abs(machine.inside(home)).max())
        said = run("touches.csv")
        touches = read_touches(folder / "touches.csv", cell)
        felt, code = machine.felt(), machine.shut_down()
        return Run(touches.ids, touches.q, felt, refusal, moved, said, code, machine.leftovers())


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


@pytest.mark.parametrize("protocol", PORTS)
def test_every_touch_of_the_plan_is_made(runs, plan, protocol):
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
    assert runs[protocol].moved == 0.0


@pytest.mark.parametrize("protocol", PORTS)
def test_linuxcnc_ends_by_itself_and_leaves_no_process_behind(runs, protocol):
    assert runs[protocol].code == 0
    assert runs[protocol].leftovers == []
