"""What GRBL remembers, asked for by its own questions."""

import re

import numpy as np
import pytest
from virtual_robots import robot_at

from probe.virtual.grbl_state import GrblState


@pytest.fixture
def state(arc_welder, exact, plan):
    return GrblState(robot_at(arc_welder, exact, plan), axis_unit_deg=0.1)


def told(state, code):
    return b"".join(state._dollar(code)).decode()


def test_positions_are_told_in_axis_units(state, plan):
    report = state._report().decode()

    place = [float(word) for word in re.search(r"MPos:([^|>]*)", report)[1].split(",")]
    np.testing.assert_allclose(place, np.degrees(plan.approach[0]) / 0.1, atol=1e-3)
    assert report.startswith("<Idle|")


def test_a_fresh_machine_has_no_offset_no_tool_and_no_probe(state):
    assert "[TLO:0.000,0.000,0.000,0.000,0.000,0.000]" in told(state, "$#")
    assert "[PRB:0.000,0.000,0.000,0.000,0.000,0.000:0]" in told(state, "$#")
    assert re.search(r"\[GC:G0 .*G90 G94 .*T0 F0 S0\]", told(state, "$G"))


def test_settings_that_are_written_are_counted_and_questions_are_not(state):
    for code in ("$$", "$I", "$10=3", "$#"):
        told(state, code)

    assert state.settings_written == 1


def test_what_grbl_does_not_know_is_error_3(state):
    assert told(state, "$Q") == "error:3\r\n"


def test_a_pressed_emergency_stop_is_not_unlocked(state):
    state.robot.health.estop = True

    assert told(state, "$X") == told(state, "$H") == "error:79\r\n"


def test_a_machine_that_is_not_homed_begins_in_alarm_until_it_is(arc_welder, exact, plan):
    robot = robot_at(arc_welder, exact, plan)
    robot.health.homed = False
    state = GrblState(robot)
    assert state._report().startswith(b"<Alarm")

    told(state, "$H")

    assert robot.health.homed
    assert state._report().startswith(b"<Idle")
