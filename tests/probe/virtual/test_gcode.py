"""One line of G-code: its words, or the number that GRBL gives its mistake."""

import pytest

from probe.virtual.gcode import (
    MISSING,
    NO_AXES,
    NO_TOOL,
    NOT_A_LETTER,
    NOT_A_NUMBER,
    TWICE,
    TWO_MOTIONS,
    UNSUPPORTED,
    UNUSED,
    Block,
    read_block,
)

AXES = "XYZABC"


def test_the_words_of_a_line_are_read_whatever_their_order():
    expected = Block("G38.2", False, "", ("G90",), {"X": -1.5, "C": 0.25, "F": 100.0}, {"X": -1.5, "C": 0.25})

    assert read_block("G90G38.2X-1.5C.25F100", AXES) == expected
    assert read_block("F100C.25G38.2X-1.5G90", AXES) == expected


def test_numbers_of_words_may_have_leading_zeros():
    assert read_block("G01X1", AXES).motion == "G1"


@pytest.mark.parametrize(
    ("code", "number"),
    [  # the numbers of GRBL 1.1: gnea/grbl, doc/markdown/interface.md
        ("GX1", NOT_A_NUMBER),
        ("1X", NOT_A_LETTER),
        ("G1X1X2", TWICE),
        ("G2X1", UNSUPPORTED),
        ("G1D1", UNSUPPORTED),
        ("G1U1", UNSUPPORTED),  # an axis that this machine does not have
        ("G0G1X1", TWO_MOTIONS),
        ("G43.1G1X1", TWO_MOTIONS),
        ("G4", MISSING),
        ("G1X1P2", UNUSED),
        ("G38.2F100", NO_AXES),
        ("T256", NO_TOOL),
    ],
)
def test_a_mistake_has_its_number(code, number):
    assert read_block(code, AXES) == number
