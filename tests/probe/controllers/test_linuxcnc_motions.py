"""Motions of LinuxCNC's backend, and all that can go wrong in one, against a stand-in that fails to order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from linuxcncrsh_fake import NEVER_RAN, fed

from probe.controllers.linuxcnc_mdi import AXES, motion_words
from probe.controllers.linuxcncrsh import Shell
from probe.line.controller import Contact, NoContact, Refused

RATE = np.radians(10.0)
TARGET = np.radians([10.0, -5.0, 3.0, 20.0, 0.0, -2.0])
joints = arrays(float, 6, elements=st.floats(-180, 180))


# motions


@given(joints, joints, arrays(float, 6, elements=st.floats(-5e-7, 5e-7)), st.floats(0.01, 100))
def test_a_motion_lasts_as_long_as_asked_whichever_joints_move(start, target, unknown, seconds):
    words = motion_words(start, target, seconds)

    told = {word[0]: float(word[1:]) for word in words.split()}
    really = start + unknown  # LinuxCNC tells six decimals
    end = np.array([told.get(axis, really[i]) for i, axis in enumerate(AXES)])
    assert not words or fed(really, end, told["F"]) == pytest.approx(seconds, rel=3e-3)
    assert np.abs(end - target).max() < 2e-3


@pytest.mark.parametrize("way", [1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1.0])
def test_a_motion_that_hardly_moves_x_y_and_z_is_no_faster_for_it(way):
    start, target = np.zeros(6), np.array([way, 0, 0, 30.0, 0, 0])

    words = motion_words(start, target, 3.0)

    told = {word[0]: float(word[1:]) for word in words.split()}
    for off in (-5e-7, 5e-7):
        really = np.array([off, 0, 0, 0, 0, 0])
        end = np.array([told.get(axis, really[i]) for i, axis in enumerate(AXES)])
        assert fed(really, end, told["F"]) == pytest.approx(3.0, rel=2e-3)


def test_a_move_goes_where_it_is_sent_at_its_rate(linuxcnc, controller):
    stood = controller.move(TARGET, RATE)

    assert np.degrees(stood) == pytest.approx(np.degrees(TARGET), abs=1e-6)
    assert linuxcnc.motions[-1][0] == "G1"
    assert linuxcnc.motions[-1][3] == pytest.approx(2.0, rel=1e-6)  # 20 deg at 10 deg/s


def test_a_contact_is_latched_where_it_happened_and_carries_the_number_of_its_search(linuxcnc, controller):
    linuxcnc.contact_at = 0.4
    number = controller.sequence

    found = controller.search(TARGET, RATE)

    assert isinstance(found, Contact)
    assert np.degrees(found.q) == pytest.approx(0.4 * np.degrees(TARGET), abs=1e-6)
    assert (found.sequence, found.boot) == (number, controller.state().boot)
    assert controller.latch().sequence == number


def test_a_search_that_meets_nothing_says_so_and_leaves_no_latch(controller):
    found = controller.search(TARGET, RATE)

    assert isinstance(found, NoContact)
    assert np.degrees(found.q) == pytest.approx(np.degrees(TARGET), abs=1e-6)
    assert controller.latch() is None


def test_a_search_of_no_length_meets_nothing(linuxcnc, controller):
    found = controller.search(np.zeros(6), RATE)

    assert isinstance(found, NoContact)
    assert not linuxcnc.motions


# what goes wrong


def test_a_search_that_never_ran_does_not_return_the_latch_of_the_one_before(linuxcnc, controller):
    linuxcnc.contact_at = 0.4
    controller.search(TARGET, RATE)
    controller.move(np.zeros(6), RATE)
    linuxcnc.fail = [NEVER_RAN]

    with pytest.raises(Refused) as refused:
        controller.search(TARGET, RATE)

    assert refused.value.code == "LOST"
    assert len([code for code, *_ in linuxcnc.motions if code == "G38.3"]) == 1


def test_a_retract_that_never_ran_is_not_taken_for_done(linuxcnc, controller):
    linuxcnc.contact_at = 0.4
    controller.search(TARGET, RATE)
    linuxcnc.fail = [NEVER_RAN]

    with pytest.raises(Refused) as refused:
        controller.move(np.zeros(6), RATE)

    assert refused.value.code == "LOST"


def test_a_refused_search_does_not_return_the_latch_of_the_one_before(linuxcnc, controller):
    linuxcnc.contact_at = 0.4
    controller.search(TARGET, RATE)
    controller.move(np.zeros(6), RATE)
    linuxcnc.fail = ["Probe move on line 0 would exceed Z's positive limit"]

    with pytest.raises(Refused) as refused:
        controller.search(TARGET, RATE)

    assert refused.value.code == "LIMIT"
    assert "would exceed Z's positive limit" in str(refused.value)
    assert controller.latch() is None


@pytest.mark.parametrize("tripped", [-1.0, 0.0])
def test_a_search_that_somebody_aborts_is_no_miss(linuxcnc, controller, tripped):
    def aborted() -> None:
        linuxcnc.clock.sleep(0.5)
        linuxcnc._stop()
        linuxcnc.parameters["#5070"] = tripped  # it has been seen to say both

    linuxcnc.fail = [aborted]

    with pytest.raises(Refused) as refused:
        controller.search(TARGET, RATE)

    assert refused.value.code == "STOPPED"
    assert controller.latch() is None


def test_a_move_that_somebody_aborts_is_told_as_that(linuxcnc, controller):
    def aborted() -> None:
        linuxcnc.clock.sleep(0.5)
        linuxcnc._stop()

    linuxcnc.fail = [aborted]

    with pytest.raises(Refused) as refused:
        controller.move(TARGET, RATE)

    assert refused.value.code == "STOPPED"


def test_an_emergency_stop_during_a_search_is_told_as_one(linuxcnc, controller):
    def pressed() -> None:
        linuxcnc.clock.sleep(0.5)
        linuxcnc._stop()
        linuxcnc.estop, linuxcnc.machine = "ON", "OFF"

    linuxcnc.fail = [pressed]

    with pytest.raises(Refused) as refused:
        controller.search(TARGET, RATE)

    assert refused.value.code == "ESTOP"
    assert linuxcnc.estop == "ON"  # and nobody resets it behind the operator's back


def test_a_closed_input_is_seen_before_a_search_begins(linuxcnc, controller):
    linuxcnc.closed = True

    with pytest.raises(Refused) as refused:
        controller.search(TARGET, RATE)

    assert refused.value.code == "ALREADY"
    assert not linuxcnc.motions


def test_an_early_contact_ends_a_move(linuxcnc, controller):
    linuxcnc.fail = [lambda: linuxcnc.trip(0.3)]

    with pytest.raises(Refused) as refused:
        controller.move(TARGET, RATE)

    assert refused.value.code == "EARLY"
    assert np.degrees(controller.state().q) == pytest.approx(0.3 * np.degrees(TARGET), abs=1e-6)


def test_a_contact_that_chatters_does_not_end_a_retract(linuxcnc, controller):
    linuxcnc.contact_at = 0.4
    controller.search(TARGET, RATE)
    linuxcnc.fail = [lambda: linuxcnc.trip(0.02), lambda: linuxcnc.trip(0.02)]

    stood = controller.move(np.zeros(6), RATE)

    assert np.abs(stood).max() < 1e-8


def test_a_retract_that_meets_something_else_further_on_ends_there(linuxcnc, controller):
    linuxcnc.contact_at = 0.4
    controller.search(TARGET, RATE)
    linuxcnc.fail = [lambda: linuxcnc.trip(0.6)]

    with pytest.raises(Refused) as refused:
        controller.move(np.zeros(6), RATE)

    assert refused.value.code == "EARLY"
    assert len(linuxcnc.motions) == 2


def test_a_motion_that_does_not_go_on_is_stopped(linuxcnc, controller):
    linuxcnc.fail = [linuxcnc.hold]
    number = controller.sequence

    with pytest.raises(Refused) as refused:
        controller.move(TARGET, RATE)

    assert refused.value.code == "NOTREACHED"
    assert "set abort" in linuxcnc.requests
    assert controller.sequence == number + 1  # it was begun, though not ended


def test_a_keyboard_interrupt_in_a_search_leaves_a_controller_that_can_be_stopped_and_used(linuxcnc, controller):
    begun = linuxcnc.clock.now()

    def interrupt() -> None:
        if linuxcnc.clock.now() > begun + 1.0:
            linuxcnc.on_read = lambda: None
            raise KeyboardInterrupt

    linuxcnc.fail = [lambda: setattr(linuxcnc, "on_read", interrupt)]
    with pytest.raises(KeyboardInterrupt):
        controller.search(TARGET, RATE)

    controller.stop()
    state = controller.state()

    assert not state.moving
    assert 0 < np.abs(state.q).max() < np.abs(TARGET).max()
    assert np.degrees(controller.move(np.zeros(6), RATE)) == pytest.approx(0, abs=1e-6)


def test_an_answer_that_nobody_waited_for_is_not_taken_for_the_next(linuxcnc):
    def interrupt() -> None:
        linuxcnc.on_read = lambda: None
        raise KeyboardInterrupt

    shell = Shell(linuxcnc, linuxcnc.clock)
    shell.greet()
    linuxcnc.on_read = interrupt
    with pytest.raises(KeyboardInterrupt):
        shell.numbers("joint_pos")
    linuxcnc._rest = np.arange(6.0)

    assert shell.numbers("joint_pos") == pytest.approx(np.arange(6.0))


def test_a_request_that_was_cut_short_does_not_run_and_a_stop_after_it_does(linuxcnc, controller):
    linuxcnc.write(b"set mdi G1 F100 X1")  # of X12.5

    controller.stop()

    assert not linuxcnc.motions
    assert "set abort" in linuxcnc.requests
