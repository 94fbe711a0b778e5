"""Parts of a program: every touch once, in order, in as few files as the registers allow."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from probe.programs.options import Options
from probe.programs.part import folded, joined, parts, percent


def made(count, capacity, per_file=None, robot=None):
    touches = [SimpleNamespace(number=k, id=f"t{k}") for k in range(1, count + 1)]
    return parts(touches, Options(per_file=per_file), 123456, 5.0, robot, capacity)


@given(st.integers(1, 200), st.integers(1, 60), st.none() | st.integers(1, 80))
def test_every_touch_is_in_one_file_and_no_file_holds_too_many(count, capacity, per_file):
    files = made(count, capacity, per_file)

    most = min(capacity, per_file or capacity)
    assert [touch.number for part in files for touch in part.routines] == list(range(1, count + 1))
    assert len(files) == -(-count // most)
    sizes = [len(part.routines) for part in files]
    assert max(sizes) <= most
    assert max(sizes) - min(sizes) <= 1


def test_a_file_says_what_it_holds_and_logs_the_same():
    second = made(30, 20)[1]

    assert (second.name, second.first, second.header) == ("TC2", 16, (123456, 16, 15, 5000))
    assert "touches t16 to t30 of the plan, stamp 123456" in second.remarks


@given(st.text("abc ", min_size=1, max_size=80).filter(str.strip), st.integers(4, 40))
def test_remarks_lose_no_word_and_lines_are_too_wide_only_where_a_word_is(text, width):
    lines = list(folded(text, width))

    assert " ".join(lines).split() == text.split()
    assert all(len(line) <= width or " " not in line for line in lines)


def test_no_joint_is_written_as_minus_zero():
    assert joined(np.array([-0.0004, 1.25, -3.0]), 2) == "0.00,1.25,-3.00"
    assert joined(np.array([1.0]), 1, pattern="A{number} {value}") == "A1 1.0"


@pytest.mark.parametrize(("share", "expected"), [(0.0001, 1), (0.019, 1), (0.3, 30)])
def test_a_speed_is_never_rounded_to_standing_still_nor_up(share, expected):
    assert percent(share) == expected
