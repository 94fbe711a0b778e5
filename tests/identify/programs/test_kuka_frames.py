"""Tool and base of KRL positions: what is taught with them, or what was set last before."""

import numpy as np
import pytest

from identify.programs.kuka_frames import DEFAULT, UNKNOWN, uses
from identify.programs.kuka_values import structures
from identify.programs.source import Source


def read(*texts):
    return uses([(text, structures(Source("p", text), text)) for text in texts])


def test_what_is_taught_with_a_position_holds_for_it():
    frame, tool, why = read("DECL FDAT FP1={TOOL_NO 3,BASE_NO 0,IPO_FRAME #BASE}").of("XP1")

    np.testing.assert_array_equal(frame.T, np.eye(4))  # base 0 is the robot's own
    assert (tool.name, why) == ("3", "")


def test_a_tool_that_stands_still_is_said_so():
    assert "the tool stands still" in read("FDAT FP1={TOOL_NO 3,BASE_NO 1,IPO_FRAME #TCP}").of("XP1")[2]


def test_what_was_set_last_before_holds():
    text = "DEF p()\nBAS(#BASE,2)\nPTP A\nBAS(#BASE,5)\nPTP B\n$BASE={X 10,Y 0,Z 0,A 0,B 0,C 0}\nLIN C\n"

    found = read(text)

    assert [found.of(name)[0].name for name in "AB"] == ["2", "5"]
    np.testing.assert_allclose(found.of("C")[0].T[:3, 3], [10, 0, 0])
    assert found.at(0) == DEFAULT


def test_what_is_computed_is_not_known():
    assert read("$TOOL=f(3)\nPTP A\n").of("A")[2] == UNKNOWN


def test_a_position_used_with_two_bases_says_so_and_one_used_twice_alike_does_not():
    text = "BAS(#BASE,2)\nPTP A\nPTP B\nBAS(#BASE,5)\nPTP A\nBAS(#BASE,2)\nPTP B\n"

    assert read(text).of("A")[2] == "frame: it is used with more than one base or tool"
    assert read(text).of("B")[2] == ""


@pytest.mark.parametrize("name", ["NOWHERE", "XP9"])
def test_a_position_that_nobody_moves_to_has_the_default(name):
    assert read("PTP A\n").of(name) == DEFAULT
