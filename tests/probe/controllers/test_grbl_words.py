"""What GRBL prints and is told: published lines are read, spoiled ones are none, and one byte changed is an error."""

import numpy as np
import pytest

from probe.controllers.grbl_words import ALARMS, axis_words, offset, read_probe, read_report, refusal, trigger
from probe.virtual.gcode import Block, read_block

REPORT = "<Idle|MPos:1.000,-2.500,3.000,4.000,5.000,6.000|FS:0,0|Pn:P>"


def test_a_report_tells_state_place_and_pin():
    report = read_report(REPORT, 6)

    assert (report.state, report.probe) == ("Idle", True)
    np.testing.assert_array_equal(report.position, [1, -2.5, 3, 4, 5, 6])
    assert not read_report(REPORT.replace("|Pn:P", "|Pn:XYZ"), 6).probe
    assert read_report(REPORT.replace("Idle", "Hold:1"), 6).state == "Hold"


@pytest.mark.parametrize(
    "line",
    [
        "ok",
        REPORT[:-1],
        REPORT.replace("MPos", "WPos"),
        REPORT.replace("-2.500", "-2.5x"),
        REPORT.replace(",6.000", ""),
    ],
)
def test_a_report_that_is_none_or_says_less_is_none(line):
    assert read_report(line, 6) is None


def test_a_probe_result_tells_whether_it_touched():
    line = "[PRB:1.000,2.000,3.000,4.000,5.000,6.000:1]"

    assert read_probe(line, 6).success
    assert not read_probe(line.replace(":1]", ":0]"), 6).success
    assert read_probe(line.replace("3.000,", ""), 6) is None
    assert read_probe(line.replace("1.000", "nan"), 6) is None


def test_every_alarm_has_a_code_and_its_own_number_in_the_words():
    for line, (code, words) in ALARMS.items():
        assert refusal(line) == (code, f"{line} {words}".strip())
    assert refusal("ALARM:77")[0] == "NOTREACHED"
    assert refusal("error:77")[0] == "LOST"
    assert refusal("ok") is None


def test_a_target_is_an_offset_that_moves_nothing_and_the_motion_goes_to_zero(rng):
    target = rng.uniform(-180, 180, 6).round(3)

    still, motion = (read_block(line, "XYZABC") for line in (offset(target), trigger("G38.3", 6, 20.0)))

    assert isinstance(still, Block)
    assert (still.motion, still.dwell, still.offset) == ("", True, "G43.1")
    assert "G91" in still.modes
    np.testing.assert_allclose(list(still.axes.values()), target)
    assert (motion.motion, motion.modes) == ("G38.3", ("G90",))
    assert set(motion.axes.values()) == {0.0}


@pytest.mark.parametrize("at", range(len(trigger("G38.3", 6, 20.0))))
def test_a_motion_that_lost_a_byte_is_an_error_or_goes_to_the_same_place(at):
    line = trigger("G38.3", 6, 20.0)

    block = read_block(line[:at] + line[at + 1 :], "XYZABC")

    same = isinstance(block, Block) and block.motion == "G38.3" and block.axes == dict.fromkeys("XYZABC", 0.0)
    assert isinstance(block, int) or same


@pytest.mark.parametrize("word", ["G1", "G38.3"])
def test_a_motion_that_lost_its_end_is_an_error_or_relative_to_where_the_robot_stands(word):
    line = trigger(word, 6, 20.0)
    for at in range(len(line)):
        for rest in ("", "G4P.0"):  # what is sent next
            block = read_block(line[:at] + rest, "XYZABC")

            nowhere = isinstance(block, Block) and "G90" not in block.modes and not any(block.axes.values())
            assert isinstance(block, int) or nowhere


def test_axis_words_have_the_decimals_of_a_position():
    assert axis_words(np.array([1.0, -2.34567])) == "X1.000Y-2.346"
