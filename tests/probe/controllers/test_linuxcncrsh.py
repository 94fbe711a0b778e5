"""LinuxCNC's backend when the line breaks and when it first says hello, against a stand-in that fails to order."""

import numpy as np
import pytest
from linuxcncrsh_fake import NEVER_RAN, FakeLinuxCNC

from identify.model.cell import Cell
from probe.controllers.linuxcnc import LinuxCNC
from probe.line.controller import Contact, LinkLost, Rebooted, Refused, TouchError

RATE = np.radians(10.0)
TARGET = np.radians([10.0, -5.0, 3.0, 20.0, 0.0, -2.0])


# the line


def test_a_search_whose_line_breaks_is_made_once_and_still_told(linuxcnc, controller):
    linuxcnc.contact_at = 0.4
    linuxcnc.cut = lambda request: "G38.3" in request

    found = controller.search(TARGET, RATE)

    assert isinstance(found, Contact)
    assert np.degrees(found.q) == pytest.approx(0.4 * np.degrees(TARGET), abs=1e-6)
    assert len(linuxcnc.motions) == 1


def test_a_command_that_the_broken_line_swallowed_is_not_sent_again(linuxcnc, controller):
    linuxcnc.fail = [NEVER_RAN]
    linuxcnc.cut = lambda request: "G38.3" in request

    with pytest.raises(Refused) as refused:
        controller.search(TARGET, RATE)

    assert refused.value.code == "LOST"
    assert sum("G38.3" in request for request in linuxcnc.requests) == 1


def test_another_program_finds_the_latch_and_the_number_of_the_one_that_died(linuxcnc, controller, arc_welder):
    linuxcnc.contact_at = 0.4
    found = controller.search(TARGET, RATE)
    linuxcnc.reopen()

    heir = LinuxCNC(linuxcnc, arc_welder.robot, linuxcnc.clock)
    heir.connect()

    assert (heir.latch().boot, heir.latch().sequence) == (found.boot, found.sequence)
    assert heir.latch().q == pytest.approx(found.q)
    assert heir.sequence == controller.sequence


def test_a_restart_is_noticed_and_nothing_moves_after_it(linuxcnc, controller):
    before = controller.state().boot
    linuxcnc.restart()

    with pytest.raises(Rebooted):
        controller.move(TARGET, RATE)
    with pytest.raises(Refused) as refused:
        controller.move(TARGET, RATE)
    linuxcnc.estop, linuxcnc.machine, linuxcnc.homed = "OFF", "ON", True
    after = controller.state().boot

    assert refused.value.code == "UNHOMED"
    assert not linuxcnc.motions
    assert after not in ("", before)


def test_a_restart_is_noticed_though_the_machine_is_homed_again(linuxcnc, controller):
    linuxcnc.restart()
    linuxcnc.estop, linuxcnc.machine, linuxcnc.homed = "OFF", "ON", True

    with pytest.raises(Rebooted):
        controller.move(TARGET, RATE)

    assert not linuxcnc.motions


def test_a_restart_is_told_once_by_the_state_too(linuxcnc, controller):
    linuxcnc.restart()

    with pytest.raises(Rebooted):
        controller.state()

    assert (controller.state().homed, controller.state().boot) == (False, "")


def test_a_line_that_stays_gone_is_given_up(linuxcnc, controller):
    def gone() -> None:
        raise LinkLost("gone")

    linuxcnc.open, linuxcnc.reopen = False, gone

    with pytest.raises(LinkLost):
        controller.state()


def test_messages_that_another_screen_takes_are_asked_for_again(linuxcnc, controller):
    linuxcnc.contact_at, linuxcnc.stolen = 0.4, 3

    assert isinstance(controller.search(TARGET, RATE), Contact)


def test_a_screen_that_takes_every_message_is_named(linuxcnc, controller):
    linuxcnc.stolen = 10**6

    with pytest.raises(TouchError, match="does another screen take its messages"):
        controller.search(TARGET, RATE)


def test_a_program_that_takes_control_is_named(linuxcnc, controller):
    linuxcnc.enabled = False

    with pytest.raises(Refused, match="another program has taken control"):
        controller.move(TARGET, RATE)

    assert controller.state().q == pytest.approx(np.zeros(6))  # looking is free


# the first greeting


def connecting(linuxcnc: FakeLinuxCNC, cell: Cell, **options: bool) -> LinuxCNC:
    controller = LinuxCNC(linuxcnc, cell.robot, linuxcnc.clock, **options)
    controller.connect()
    return controller


def test_an_unhomed_machine_is_refused_and_nothing_moves(linuxcnc, arc_welder):
    linuxcnc.homed = False

    with pytest.raises(Refused, match=r"not homed.*joint 1, 2, 3, 4, 5, 6") as refused:
        connecting(linuxcnc, arc_welder)

    assert refused.value.code == "UNHOMED"
    assert not any("home" in request.split()[1:2] for request in linuxcnc.requests if request.startswith("set"))
    assert not linuxcnc.motions


def test_a_machine_is_homed_where_that_is_asked_for(linuxcnc, arc_welder):
    linuxcnc.homed, linuxcnc.estop, linuxcnc.machine, linuxcnc.mode = False, "ON", "OFF", "MANUAL"

    connecting(linuxcnc, arc_welder, home=True)

    assert linuxcnc.homed
    assert linuxcnc.mode == "MDI"


def test_a_running_program_is_left_alone(linuxcnc, arc_welder):
    linuxcnc.running_program, linuxcnc.mode = True, "AUTO"

    with pytest.raises(Refused, match="a program runs on it"):
        connecting(linuxcnc, arc_welder)

    assert "set abort" not in linuxcnc.requests


def test_an_emergency_stop_that_cannot_be_reset_is_told(linuxcnc, arc_welder):
    linuxcnc.estop = "ON"
    linuxcnc._set, inner = (lambda name, value: name == "estop" or inner(name, value)), linuxcnc._set

    with pytest.raises(Refused) as refused:
        connecting(linuxcnc, arc_welder)

    assert refused.value.code == "ESTOP"


@pytest.mark.parametrize("offset", [[0, 0, 2.5, 0, 0, 0], [0, 0, 0, 0, 0, 90.0]])
def test_a_work_offset_is_refused(linuxcnc, arc_welder, offset):
    linuxcnc.offset = np.array(offset)

    with pytest.raises(Refused, match=f"axis {'ZC'[offset[2] == 0]} is .* away from its joint"):
        connecting(linuxcnc, arc_welder)


def test_a_rotated_work_offset_is_refused(linuxcnc, arc_welder):
    linuxcnc.parameters |= {"#5220": 2.0, "#5250": 30.0}

    with pytest.raises(Refused, match=r"rotated by 30 deg.*G10 L2 P2 R0"):
        connecting(linuxcnc, arc_welder)


def test_another_robot_is_refused(linuxcnc, arc_welder):
    linuxcnc.units = ["MM"] * 3

    with pytest.raises(Refused, match="count in MM MM MM, expected DEG DEG DEG DEG DEG DEG"):
        connecting(linuxcnc, arc_welder)


def test_somebody_else_at_the_port_is_recognised(linuxcnc, arc_welder):
    linuxcnc._hear = lambda line: linuxcnc._say("? NAK*1D0F")

    with pytest.raises(LinkLost, match=r"something else than linuxcncrsh answers \('\? NAK\*1D0F'\)"):
        connecting(linuxcnc, arc_welder)


def test_silence_at_the_port_is_told(linuxcnc, arc_welder):
    linuxcnc._hear = lambda line: None

    with pytest.raises(LinkLost, match="nothing answers at socket://robot:5007; is linuxcncrsh running"):
        connecting(linuxcnc, arc_welder)


def test_a_wrong_password_is_told(linuxcnc, arc_welder):
    linuxcnc._hear = lambda line: linuxcnc._say("HELLO NAK")

    with pytest.raises(TouchError, match="does not take the password 'EMC'"):
        connecting(linuxcnc, arc_welder)
