"""Numbers are found where programs hold them: what Python writes is read whole, and words are none."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from identify.programs.numbers import NUMBER, WIDEST, Number, number, same, spaces_before


@given(st.floats(-1e14, 1e14).filter(lambda v: v == 0 or abs(v) > 1e-12))
def test_what_python_writes_of_a_number_is_one(value):
    match = re.fullmatch(NUMBER, repr(value))

    assert match is not None
    assert number(match).value == value


@pytest.mark.parametrize("text", ["1.2.3", "12abc", "1234567890123456", "1e999", "..5", "x1"])
def test_what_is_cut_out_of_a_word_is_no_number(text):
    assert re.fullmatch(NUMBER, text) is None


@given(st.integers(0, 60))
def test_spaces_are_counted_up_to_the_widest(count):
    assert spaces_before(f"x{' ' * count}1", count + 1) == min(count, WIDEST)


@given(st.floats(-1e3, 1e3), st.integers(0, 6), st.floats(-1e-3, 1e-3))
def test_a_number_says_a_value_that_rounds_to_it_and_no_other(value, digits, off):
    text = f"{value:.{digits}f}"
    half = 0.5 * 10.0**-digits

    if abs(abs(value + off - float(text)) - half) > 1e-9:  # not on the edge
        assert same(text, value + off, 0) == (abs(value + off - float(text)) < half)


def test_a_number_after_one_space_owns_none_of_it_unless_its_format_lines_numbers_up():
    match = re.search(NUMBER, "X 1.5")

    assert (number(match).lead, number(match, padded=True).lead) == (0, 1)
    assert number(re.search(NUMBER, "X   1.5")) == Number(4, 7, "1.5", 3)
