"""Lines of programs whatever their ends; texts of two bytes a character are refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from identify.model.files import InputError
from identify.programs.source import Scanner, Source, source_of


@given(st.lists(st.sampled_from(["a", "bc", "\n", "\r\n", "\r", " "]), max_size=30))
def test_the_line_of_a_place_is_one_more_than_the_line_ends_before_it(parts):
    text = "".join(parts)
    source = Source("p", text)

    for at in range(len(text)):
        inside = text[at - 1 : at + 1] == "\r\n"  # between both halves of one end
        before = text[:at].replace("\r\n", "\n").replace("\r", "\n").count("\n")
        assert inside or source.line(at) == before + 1


@pytest.mark.parametrize("content", ["X 1".encode("utf-16"), b"X\x001"])
def test_a_text_of_two_bytes_a_character_is_refused(content):
    with pytest.raises(InputError, match=r"p\.ls: not a text of single bytes \(UTF-16\?\); save it as"):
        source_of("p.ls", content)


def test_a_scanner_reads_on_past_white_space_and_leaves_what_does_not_match():
    scan = Scanner(Source("p", "  Move\n\tJ P[1]"))

    assert scan.take(r"move")[0] == "Move"  # capitals do not matter
    assert scan.take(r"\d") is None
    assert scan.need(r"J", "a motion")[0] == "J"
    assert scan.source.text[scan.skip() :] == "P[1]"


@pytest.mark.parametrize(("at", "near"), [(0, "'word'"), (4, "the end of the line"), (10, "the end")])
def test_what_stands_at_a_place_is_told_in_a_word(at, near):
    assert Source("p", "word, more").near(at) == near
