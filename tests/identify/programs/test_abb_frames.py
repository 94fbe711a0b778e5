"""Tools and work objects of RAPID: what declarations and motions say of a target."""

import numpy as np
import pytest

from identify.model.frames import transform
from identify.programs.abb_data import aggregates
from identify.programs.abb_frames import Declared, declared, uses
from identify.programs.source import Source

POSE = "[[%s,0,0],[0.70710678,0,0,0.70710678]]"  # turned a quarter about z
WOBJ = f'PERS wobjdata w1:=[FALSE,TRUE,"",{POSE % 100},{POSE % 10}];'
TOOL = f"PERS tooldata tGun:=[TRUE,{POSE % 7},[1,[0,0,1],[1,0,0,0],0,0,0]];"


def of(text):
    return declared(text, aggregates(Source("p.mod", text), text), Declared())


def test_a_work_object_is_its_user_frame_and_then_its_object_frame():
    frame, tool, why = of(WOBJ + TOOL).place("TGUN", "W1")

    quarter = np.pi / 2
    user, own = (transform(np.array([x, 0, 0, quarter, 0, 0])) for x in (100.0, 10.0))
    np.testing.assert_allclose(frame.T, user @ own, atol=1e-6)
    np.testing.assert_allclose(tool.T, transform(np.array([7.0, 0, 0, quarter, 0, 0])), atol=1e-6)
    assert why == ""


def test_tool0_and_wobj0_are_flange_and_base():
    frame, tool, why = Declared().place("tool0", "")

    np.testing.assert_array_equal(frame.T, np.eye(4))
    np.testing.assert_array_equal(tool.T, np.eye(4))
    assert why == ""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (WOBJ.replace("FALSE", "TRUE"), "frame: the robot holds its work object"),
        (WOBJ.replace("FALSE,TRUE", "FALSE,FALSE"), "frame: its work object moves with another mechanism"),
    ],
)
def test_a_work_object_that_moves_says_why_targets_stay(text, why):
    assert of(text).place("tool0", "w1")[2] == why


def test_a_target_has_the_tool_and_the_work_object_of_every_motion_to_it():
    text = r"MoveL p1,v100,z10,tGun\WObj:=w1; MoveJ Offs(p1,0,0,5),v100,fine,tool0; MoveAbsJ p2,v5,fine,tGun;"

    found = uses([text])

    assert list(found.of("P1")) == [("tGun", "w1"), ("tool0", "")]
    assert list(found.of("p2")) == []
