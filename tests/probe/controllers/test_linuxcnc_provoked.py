"""The backend against a real LinuxCNC that is provoked: limits, aborts, contacts out of turn, a line that breaks."""

import time
from collections.abc import Iterator

import numpy as np
import pytest
from linuxcnc_cell import HOME, cell_of_the_test, short_plan, true_robot
from linuxcnc_running import BRIDGE, RSH, LinuxCNCRunning, needed

import probe
from identify.model.files import InputError
from identify.model.touch import Plan
from probe.controllers.linuxcnc import LinuxCNC
from probe.controllers.linuxcncrsh import Shell
from probe.line.clock import Clock
from probe.line.controller import Contact, LinkLost, NoContact, Rebooted, Refused
from probe.line.transport import SerialTransport

pytestmark = pytest.mark.xdist_group("linuxcnc provoked")  # one LinuxCNC for all of them
RATE = np.radians(20.0)  # [rad/s]


@pytest.fixture(scope="module")
def plan() -> Plan:
    return short_plan(cell_of_the_test(), 1)


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LinuxCNCRunning]:
    """A LinuxCNC, homed."""
    needed()
    cell = cell_of_the_test()
    with LinuxCNCRunning(tmp_path_factory.mktemp("provoked"), cell, true_robot(cell)) as running:
        opened(running, home=True).close()
        yield running


@pytest.fixture(scope="module")
def driver(machine: LinuxCNCRunning) -> Iterator[LinuxCNC]:
    made = opened(machine)
    yield made
    made.close()


@pytest.fixture
def controller(machine: LinuxCNCRunning, driver: LinuxCNC) -> LinuxCNC:
    """The driver of that machine, in control of it, at home."""
    if not driver._shell.set("mode mdi"):
        machine.inside(driver._shell.reopen)
    driver.move(HOME, 1.0)
    return driver


def opened(machine: LinuxCNCRunning, home: bool = False) -> LinuxCNC:
    robot = cell_of_the_test().robot
    return machine.inside(lambda: probe.open_controller(RSH, "linuxcnc", robot, home=home))


def touch(controller: LinuxCNC, plan: Plan) -> Contact | NoContact:
    controller.move(plan.approach[0], 1.0)
    return controller.search(2 * plan.q[0] - plan.approach[0], RATE)


@pytest.mark.parametrize(
    "way",
    [
        pytest.param([10, 5, -5, 3, 0, 2], id="all"),
        pytest.param([0, 0, 0, 10, -4, 10], id="wrist"),
        pytest.param([1e-5, 0, 0, 10, -4, 10], id="wrist and a hair"),
        pytest.param([2e-3, 0, 0, 10, -4, 10], id="wrist and a little"),
    ],
)
def test_a_motion_is_not_faster_than_asked(controller, way):
    begun = time.monotonic()

    stood = controller.move(np.radians(way), np.radians(10.0))

    assert time.monotonic() - begun > 0.8  # [s] of 1 s: a machine that lags behind may catch up
    assert np.abs(np.degrees(stood) - way).max() < 2e-3


def test_a_search_beyond_the_limits_is_refused_in_linuxcncs_words_and_does_not_move(controller):
    with pytest.raises(Refused, match="would exceed") as refused:
        controller.search(np.radians([0, 0, 151.0, 0, 0, 0]), RATE)

    assert refused.value.code == "LIMIT"
    assert np.abs(controller.state().q).max() < 1e-8


def test_a_search_in_free_air_ends_at_its_end(controller):
    found = controller.search(np.radians([3.0, 0, 0, 0, 2, 0]), RATE)

    assert isinstance(found, NoContact)
    assert np.degrees(found.q) == pytest.approx([3.0, 0, 0, 0, 2, 0], abs=1e-3)
    assert controller.latch() is None


def test_a_latch_outlives_the_program_that_made_it(machine, controller, plan):
    found = touch(controller, plan)

    heir = opened(machine)
    latch, state = heir.latch(), heir.state()

    assert isinstance(found, Contact)
    assert (latch.boot, latch.sequence) == (found.boot, found.sequence)
    assert latch.q == pytest.approx(found.q, abs=1e-9)
    assert heir.sequence == found.sequence + 1
    assert state.contact
    heir.close()


def test_a_search_that_begins_in_contact_is_refused_and_the_way_back_is_not(controller, plan):
    touch(controller, plan)

    with pytest.raises(Refused) as refused:
        controller.search(plan.q[0], RATE)
    stood = controller.move(plan.approach[0], RATE)

    assert refused.value.code == "ALREADY"
    assert stood == pytest.approx(plan.approach[0], abs=1e-6)


def test_an_early_contact_ends_a_move_and_is_told(controller, plan):
    controller.move(plan.approach[0], 1.0)

    with pytest.raises(Refused) as refused:
        controller.move(2 * plan.q[0] - plan.approach[0], RATE)
    state = controller.state()
    controller.move(plan.approach[0], RATE)

    assert refused.value.code == "EARLY"
    assert state.contact
    assert not controller.state().contact


def test_an_interrupted_search_is_stopped_on_its_way_and_leaves_no_latch(controller, monkeypatch):
    def interrupted(watch: object = None) -> None:
        time.sleep(0.4)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(controller._machine, "settle", interrupted)
        with pytest.raises(KeyboardInterrupt):
            controller.search(np.radians([40.0, 0, 0, 0, 0, 0]), RATE)

    controller.stop()
    state = controller.state()

    assert not state.moving
    assert 0.1 < np.degrees(state.q[0]) < 39.9
    assert controller.latch() is None


@pytest.mark.parametrize(
    ("takes_control", "code"), [(False, "STOPPED"), (True, "BUSY")], ids=["at the machine", "by another program"]
)
def test_an_aborted_search_is_not_a_miss(machine, controller, monkeypatch, takes_control, code):
    other = Shell(machine.inside(lambda: SerialTransport(RSH)), Clock())
    settle = controller._machine.settle

    def aborted(watch: object = None) -> None:
        time.sleep(0.3)
        if takes_control:
            other.greet()
        (other if takes_control else controller._shell).abort()
        settle()

    with monkeypatch.context() as patch:
        patch.setattr(controller._machine, "settle", aborted)
        with pytest.raises(Refused) as refused:
            controller.search(np.radians([40.0, 0, 0, 0, 0, 0]), RATE)

    assert refused.value.code == code
    assert 0.1 < np.degrees(controller.state().q[0]) < 39.9
    other.transport.close()


def test_a_search_whose_line_breaks_is_stopped_and_is_no_touch(machine, controller, plan, monkeypatch):
    """Nobody watches a motion while the line is broken: it used to go on to its end."""
    controller.move(plan.approach[0], 1.0)
    transport, wire = controller._shell.transport, controller._shell.transport.write

    def write(data: bytes) -> None:
        wire(data)
        if b"G38.3" in data:
            transport.close()
            raise LinkLost("cut")

    with monkeypatch.context() as patch:
        patch.setattr(transport, "write", write)
        with pytest.raises(Refused) as refused:
            machine.inside(lambda: controller.search(2 * plan.q[0] - plan.approach[0], RATE / 4))
    controller.move(plan.approach[0], RATE)

    assert refused.value.code == "STOPPED"


@pytest.mark.parametrize(
    ("offset", "sentence"), [("X5", "axis X is 5.0000 away from its joint"), ("R30", "rotated by 30 deg")]
)
def test_a_work_offset_is_refused_before_anything_moves(machine, controller, offset, sentence):
    controller._machine.mdi(f"G10 L2 P1 {offset}")

    with pytest.raises(InputError, match=sentence):
        opened(machine)

    machine.inside(controller._shell.reopen)
    controller._machine.mdi("G10 L2 P1 X0 R0")
    controller.stop()


@pytest.mark.parametrize(("port", "protocol"), [(RSH, "line"), (BRIDGE, "linuxcnc")])
def test_a_controller_of_another_protocol_is_refused_in_one_sentence(machine, port, protocol):
    robot = cell_of_the_test().robot

    with pytest.raises(InputError) as refusal:
        machine.inside(lambda: probe.open_controller(port, protocol, robot))

    assert "\n" not in str(refusal.value)
    assert protocol in str(refusal.value)


def test_a_restart_is_noticed_and_nothing_moves_until_the_operator_has_homed_it(machine, driver):
    before = driver.state().boot
    machine.restart()

    with pytest.raises(Rebooted, match="position is not trusted any more"):
        machine.inside(lambda: driver.move(np.radians([5.0, 0, 0, 0, 0, 0]), RATE))
    with pytest.raises(Refused) as refused:
        driver.move(np.radians([5.0, 0, 0, 0, 0, 0]), RATE)
    state = driver.state()
    again = opened(machine, home=True)

    assert refused.value.code == "UNHOMED"
    assert (state.boot, state.homed, np.abs(state.q).max()) == ("", False, 0.0)
    assert again.state().boot not in ("", before)
    again.close()
