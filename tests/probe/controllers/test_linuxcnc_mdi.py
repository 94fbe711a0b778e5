"""Feeds of LinuxCNC: it counts X, Y and Z alone, and A, B and C where none of those moves."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from probe.controllers.linuxcnc_mdi import SLOWEST, code_of, motion_words, read_report

angles = st.lists(st.floats(-170, 170), min_size=6, max_size=6)


@given(angles, angles, st.floats(0.1, 100))
def test_the_feed_takes_the_time_asked_for_by_the_length_that_counts(start, target, seconds):
    start, target = np.array(start).round(6), np.array(target).round(6)

    words = motion_words(start, target, seconds)

    way = target - start
    length = np.linalg.norm(way[:3]) if np.linalg.norm(way[:3]) >= SLOWEST else np.linalg.norm(way[3:])
    if length < 2 * SLOWEST:
        return
    feed = float(re.search(r"F(\S+)", words)[1])
    assert 60 * length / feed == pytest.approx(seconds, rel=1e-4)
    named = {word[0]: float(word[1:]) for word in words.split()[:-1]}
    for axis, goal, step in zip("XYZABC", target, way, strict=True):
        assert axis not in named or named[axis] == pytest.approx(goal, abs=1e-6)
        assert axis in named or abs(step) <= SLOWEST


def test_nothing_is_said_where_hardly_anything_moves():
    q = np.array([1.0, 2, 3, 4, 5, 6])

    assert motion_words(q, q, 1.0) == ""
    assert motion_words(q, q + 1e-5, 1.0) == ""


def test_parameters_that_do_not_exist_yet_are_a_machine_that_nobody_greeted():
    fresh = read_report([float("nan")] * 4 + [0.0] * 12)
    greeted = read_report([float(0xA1B2), 7.0, 6.0, 1.0, *range(6), *range(6, 12)])

    assert (fresh.boot, fresh.last) == ("", 0)
    assert (greeted.boot, greeted.last, greeted.search, greeted.tripped) == ("A1B2", 7, 6, 1)
    np.testing.assert_array_equal(greeted.latched, range(6))
    np.testing.assert_array_equal(greeted.at, range(6, 12))


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("Linear move on line 0 would exceed joint 2's positive limit", "LIMIT"),
        ("Probe is already tripped when starting G38.2 move", "ALREADY"),
        ("Probe tripped during non-probe move.", "EARLY"),
        ("can't do that (EMC_TASK_PLAN_EXECUTE) until all joints are homed", "UNHOMED"),
        ("something new", "NOTREACHED"),
    ],
)
def test_messages_of_linuxcnc_mean_a_code(message, code):
    assert code_of(["hello", message], "NOTREACHED") == code
