"""Logs of lines: read as they are written, refused where they are cut or of another plan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_support import make_plan

from identify.model.files import InputError
from probe.programs.log import STAMPS, TOUCHED, header, read_lines, stamp

PATH = Path("touches.log")
TITLE = "touchcal 123456 5 2 10000"


def read(*lines):
    return read_lines(PATH, lines, np.radians)


def test_a_log_holds_code_latch_and_rest_of_the_touches_of_its_file():
    log = read(TITLE, "t 5 1 1 2 3 4 5 6", "r 5 1 2 3 4 5 7", "t 6 2 0 0 0 0 0 0", "t 9 1 0 0 0 0 0 0", "end")

    assert (log.stamp, log.first, log.count, log.speed) == (123456, 5, 2, 10.0)
    first, second = log.entries  # touch 9 is of another file
    assert (first.number, first.code, first.line) == (5, TOUCHED, 2)
    np.testing.assert_allclose(np.degrees(first.rest - first.latch), [0, 0, 0, 0, 0, 1])
    assert np.isnan(second.rest).all()


def test_a_program_that_was_started_again_logs_anew():
    log = read(TITLE, "t 5 1 1 2 3 4 5 6", TITLE, "t 6 1 1 2 3 4 5 6")

    assert [entry.number for entry in log.entries] == [6]


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        (["t 5 1 1 2 3 4 5 6"], r"touches\.log: no line 'touchcal"),
        ([TITLE, "t 5 1 1 2 3"], r"touches\.log:2: found 't 5 1 1 2 3', expected 't' or 'r'"),
        ([TITLE, "t 5 1 a b c d e f"], r"touches\.log:2: found"),
        (["touchcal 123456 5 2"], r"touches\.log:1: its header is"),
        (["touchcal 5 5 2 10000"], r"touches\.log:1: its header is"),
    ],
)
def test_a_line_that_is_none_is_refused_with_its_number(lines, sentence):
    with pytest.raises(InputError, match=sentence):
        read(*lines)


def test_a_stamp_tells_plans_and_makers_apart_and_fits_a_register(arc_welder):
    plan, robot = make_plan(arc_welder, 2), arc_welder.robot

    stamps = [
        stamp(plan, robot, "kuka"),
        stamp(plan, robot, "abb"),
        stamp(replace(plan, q=plan.q + 1e-6), robot, "kuka"),
    ]

    assert len(set(stamps)) == 3
    assert stamp(plan, robot, "kuka") == stamps[0]
    assert all(header([value, 1, 2, 3000], PATH)[0] == value for value in stamps)
    assert min(stamps) >= STAMPS[0]
