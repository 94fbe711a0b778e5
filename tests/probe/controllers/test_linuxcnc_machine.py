"""LinuxCNC looked at through a stand-in: what is homed, what moves, and parameters with a tag."""

import numpy as np
import pytest

from probe.controllers.linuxcnc_machine import Machine
from probe.line.controller import TouchError


class Shell:
    """Answers of linuxcncrsh, as they were set."""

    def __init__(self, **answers):
        self.answers, self.said = answers, []

    def get(self, what):
        answer = self.answers[what]
        return answer.pop(0) if isinstance(answer, list) else answer

    def numbers(self, what):
        return [float(word) for word in self.get(what).split()]

    def set(self, what):
        self.said.append(what)
        return True

    def messages(self):
        return []


class Ticks:
    def __init__(self):
        self.t = 0.0

    def now(self):
        return self.t

    def sleep(self, seconds):
        self.t += seconds


def machine(**answers):
    return Machine(Shell(**answers), Ticks(), 6)


def test_joints_that_are_not_homed_are_counted_from_one():
    assert machine(joint_homed="YES NO YES YES NO YES NO NO NO").unhomed() == [2, 5]


@pytest.mark.parametrize(("estop", "on", "ready"), [("OFF", "ON", True), ("ON", "ON", False), ("OFF", "OFF", False)])
def test_a_machine_is_on_where_the_stop_is_released_and_it_is_on(estop, on, ready):
    assert machine(estop=estop, machine=on).switched_on() == ready


def test_switching_on_says_only_what_is_not_so_yet():
    there = machine(estop="OFF", machine="OFF")

    there.switch_on()

    assert there.shell.said == ["machine ON"]


def test_what_changes_between_two_looks_moves_and_what_rested_is_looked_at_once():
    moving = machine(abs_cmd_pos=["0 0 0 0 0 0", "0 0 0 0 0 1"], program_status="IDLE")
    assert moving.moving()

    resting = machine(abs_cmd_pos=["1 2 3 4 5 6"] * 3, program_status="IDLE")
    assert not resting.moving()
    assert not resting.moving()  # the third answer is the last one
    np.testing.assert_array_equal(resting.shell.answers["abs_cmd_pos"], [])


def test_parameters_are_those_shown_with_the_tag_that_was_asked_for(monkeypatch):
    there = machine(operator_display="touchcal abc123 1.5 #<_x> 3")
    monkeypatch.setattr("secrets.token_hex", lambda n: "abc123")

    values = there.parameters("#1 #<_x> #3")

    assert values[0] == 1.5
    assert np.isnan(values[1])
    assert there.shell.said == ["mdi (DEBUG,touchcal abc123 #1 #<_x> #3)"]


def test_parameters_that_another_screen_takes_are_given_up_in_seconds():
    there = machine(operator_display="something else")

    with pytest.raises(TouchError, match="does another screen take its messages"):
        there.parameters("#1")

    assert there._clock.now() < 7.0
