"""Logged touches count by the rules of a live run: each rule is broken once, on touches of the nominal robot."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identify.model.files import InputError
from identify.model.io.tables import read_plan
from probe.programs.evidence import imported
from probe.programs.log import CLOSED, HELD, MISSED, NOT_MADE, OPENED, TOUCHED, Entry, Log, stamp

PLAN = Path(__file__).with_name("plan.csv")
COUNT = 6


@pytest.fixture(scope="module")
def plan(arc_welder):
    return read_plan(PLAN, arc_welder).take(np.arange(COUNT))


@pytest.fixture
def log(arc_welder, plan):
    """What a program logs of the nominal robot, which rests a little beyond each contact."""
    way = plan.q - plan.approach
    entries = tuple(
        Entry(i + 1, TOUCHED, plan.q[i], plan.q[i] + 0.002 * way[i] / np.linalg.norm(way[i]) * 0.1, i + 2)
        for i in range(COUNT)
    )
    return Log("a.log", stamp(plan, arc_welder.robot, "kuka"), 1, COUNT, 5.0, entries)


def changed(log, number, **values):
    entries = [replace(e, **values) if e.number == number else e for e in log.entries]
    return replace(log, entries=tuple(entries))


def read(cell, plan, *logs):
    return imported(logs, plan, cell, "kuka", straight=False, temperature=21.0)


def test_touches_of_the_nominal_robot_all_count_with_their_latches(arc_welder, plan, log):
    result = read(arc_welder, plan, log)

    assert result.touches.status == ("hit",) * COUNT
    np.testing.assert_array_equal(result.touches.q, plan.q)
    assert set(result.touches.temperature) == {21.0}
    assert result.missing == ()


@pytest.mark.parametrize(
    ("change", "status", "word"),
    [
        ({"code": MISSED}, "miss", "nothing met"),
        ({"code": CLOSED}, "skipped", "closed before the search"),
        ({"code": OPENED}, "skipped", "did not last"),
        ({"code": HELD}, "skipped", "still closed after the retract"),
    ],
)
def test_a_touch_whose_input_was_not_as_it_must_be_does_not_count(change, status, word, arc_welder, plan, log):
    touches = read(arc_welder, plan, changed(log, 3, **change)).touches

    assert touches.status[2] == status
    assert word in touches.note[2]
    assert set(touches.status[:2] + touches.status[3:]) == {"hit"}


def test_a_latch_off_the_line_of_search_does_not_count(arc_welder, plan, log):
    off = log.entries[2].latch + np.radians([0, 0, 0, 0.05, 0, 0])

    touches = read(arc_welder, plan, changed(log, 3, latch=off)).touches

    assert touches.status[2] == "skipped"
    assert "off the line" in touches.note[2]


def test_touches_that_no_log_tells_of_are_named(arc_welder, plan, log):
    result = read(arc_welder, plan, changed(log, 5, code=NOT_MADE))

    assert result.missing == (plan.ids[4],)
    assert len(result.touches) == COUNT - 1


def test_the_later_of_two_logs_counts(arc_welder, plan, log):
    result = read(arc_welder, plan, changed(log, 2, code=MISSED), replace(log, entries=(log.entries[1],)))

    assert result.touches.status[1] == "hit"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"stamp": 123456}, "it is the log of another plan"),
        ({"count": 100}, "it tells of touches up to 100, the plan has 6"),
    ],
)
def test_a_log_of_something_else_is_refused(change, sentence, arc_welder, plan, log):
    with pytest.raises(InputError, match=sentence):
        read(arc_welder, plan, replace(log, **change))


def test_logs_of_two_speeds_are_not_mixed(arc_welder, plan, log):
    with pytest.raises(InputError, match=r"b\.log: its search speed is 9 mm/s, that of a\.log 5"):
        read(arc_welder, plan, log, replace(log, file="b.log", speed=9.0))


def test_a_contact_without_joints_is_refused_with_its_line(arc_welder, plan, log):
    with pytest.raises(InputError, match=r"a\.log:4: touch 3 has a contact but no joints"):
        read(arc_welder, plan, changed(log, 3, rest=np.full(6, np.nan)))
