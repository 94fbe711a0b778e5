"""ABB RAPID modules: targets are told from tools and work objects, and corrected with those they are used with."""

import re

import numpy as np
import pytest
from abb_text import EAX, NUMBER, fixed, joint_target, listed, module, programs, read, target, told, tooldata, wobjdata
from hypothesis import given, settings
from programs import (
    AS_DRAWN,
    CELL,
    EXACT,
    FRAME,
    ROUND_DEG,
    ROUND_MM,
    Q,
    base_T_tip,
    from_quaternion,
    from_wpr,
    off,
    off_joints,
    quaternion,
)

from identify.compensation.postures import nominal
from identify.model.files import InputError
from identify.model.frames import inverse, transform
from identify.programs.fixing import fix
from identify.programs.setup import Setup

FLANGE_T_TIP = transform(CELL.theta[-6:])
FLANGE_T_TOOL = FLANGE_T_TIP @ from_wpr(np.array([0.0, 5.0, 20.0, 0.0, 15.0, 0.0]))


@given(programs(most=1))  # a path of one target: it is corrected, or left with its path
@settings(max_examples=25, phases=AS_DRAWN)
def test_corrected_targets_bring_the_true_robot_where_the_program_said(drawn):
    text, targets = drawn

    result = fixed(text)

    after, left = result.after.decode("latin-1"), {mention.line for mention in result.failures}
    places, again = (list(re.finditer(r'(?<!")p\d_ := \[|MoveL \[', whole)) for whole in (text, after))
    for (kind, q), old_at, new_at in zip(targets, places, again, strict=True):
        old, new = read(text[old_at.start() :], old_at[0]), read(after[new_at.start() :], new_at[0])
        if text.count("\n", 0, old_at.end()) + 1 in left:
            assert np.array_equal(old, new)
        elif kind == "jointtarget":
            assert off_joints(np.radians(new[:6]), base_T_tip(q))[0] < 0.01
        else:
            assert np.array_equal(old[7:], new[7:])
            error = off(from_quaternion(new[:7]), from_quaternion(old[:7]), q)
            assert error[0] < ROUND_MM
            assert error[1] < ROUND_DEG


@given(programs())
@settings(max_examples=12, phases=AS_DRAWN)
def test_nothing_but_numbers_changes(drawn):
    text = drawn[0]

    after = fixed(text).after.decode("latin-1")

    assert re.sub(NUMBER, "#", after) == re.sub(NUMBER, "#", text)


def test_quaternions_get_six_decimals_at_least_and_lengths_three():
    after = fixed(module(f"CONST robtarget p1:={target(Q, mm=1, unit=4)};")).after.decode()

    numbers = re.findall(r"-?\d+\.(\d+)", after)
    assert [len(n) for n in numbers] == [3, 3, 3, 6, 6, 6, 6]


def test_quaternions_in_exponents_are_read():
    T = from_wpr(np.array([*base_T_tip(Q)[:3, 3], 0.0, 0.0, 0.0])) @ from_wpr(np.array([0, 0, 0, 0, 1e-4, 150.0]))
    values = quaternion(T)
    text = module(
        f"CONST robtarget p1:=[{listed(values[:3], 3)},[{','.join(f'{v:.5E}' for v in values[3:])}],[0,0,0,0],{EAX}];"
    )

    result = fixed(text, setup=Setup(posture="nearest"))

    assert len(result.shift) + len(result.failures) == 1
    assert result.failures == () or not result.failures[0].why.startswith("orientation")


def test_tools_and_work_objects_stay_as_they_are_and_are_heeded():
    tip_T_tool = inverse(FLANGE_T_TIP) @ FLANGE_T_TOOL
    written = inverse(FRAME) @ base_T_tip(Q) @ tip_T_tool
    data = [tooldata("tGun", FLANGE_T_TOOL), wobjdata("wPart", FRAME)]
    text = module(
        *data, f"CONST robtarget p1:={target(Q, written)};", "PROC main()", "  MoveL p1,v100,fine,tGun\\WObj:=wPart;"
    )

    result = fixed(text)

    after = result.after.decode()
    assert all(line in after for line in data)
    assert off(FRAME @ told(result, "p1:=") @ inverse(tip_T_tool), base_T_tip(Q), Q)[0] < 2 * ROUND_MM
    assert result.mentions == ()


@pytest.mark.parametrize(
    "instruction",
    [
        "MoveL p1,v100,fine,tGun\\WObj:=wPart;",
        "MoveJ \\Conc,p1,v100\\T:=2,z10,tGun \\Wobj := wPart;",
        "MoveC p9,p1,v100,z10,tGun\\WObj:=wPart;",
        "ArcLStart p1,v50,seam1,weld1\\Weave:=w1,fine,tGun\\WObj:=wPart;",
        "MoveL Offs(p1,0,0,10),v100,z10,tGun\\WObj:=wPart;",
    ],
)
def test_the_tool_and_work_object_of_any_motion_are_found(instruction):
    written = inverse(FRAME) @ base_T_tip(Q) @ inverse(FLANGE_T_TIP) @ FLANGE_T_TOOL
    text = module(f"CONST robtarget p1:={target(Q, written)};", "PROC main()", "  " + instruction, "ENDPROC")

    result = fixed(text, setup=Setup({"wPart": FRAME}, {"tGun": FLANGE_T_TOOL}))

    command = FRAME @ told(result, "p1:=") @ inverse(FLANGE_T_TOOL) @ FLANGE_T_TIP
    assert off(command, base_T_tip(Q), Q)[0] < 2 * ROUND_MM
    assert [m.why.split(":")[0] for m in result.mentions] == (["offset"] if "Offs" in instruction else [])


def test_tools_declared_in_another_module_are_found():
    written = base_T_tip(Q) @ inverse(FLANGE_T_TIP) @ FLANGE_T_TOOL
    main = module(f"CONST robtarget p1:={target(Q, written)};", "PROC main()", "  MoveJ p1,v100,fine,tGun;")
    files = {"main.mod": main.encode(), "data.mod": module(tooldata("tGun", FLANGE_T_TOOL)).encode()}

    result = fix(EXACT, files)[0]

    assert off(told(result, "p1:=") @ inverse(FLANGE_T_TOOL) @ FLANGE_T_TIP, base_T_tip(Q), Q)[0] < 2 * ROUND_MM


def test_tool0_is_the_flange():
    text = module(f"MoveL {target(Q, base_T_tip(Q) @ inverse(FLANGE_T_TIP))},v100,fine,tool0;")

    assert off(told(fixed(text), "MoveL") @ FLANGE_T_TIP, base_T_tip(Q), Q)[0] < 0.01


@pytest.mark.parametrize(
    ("data", "use", "why"),
    [
        (tooldata("tGun", FLANGE_T_TOOL, "FALSE"), "tGun", "frame: its tool stands still and the robot holds the work"),
        (wobjdata("wPart", FRAME, 'TRUE,TRUE,""'), "t\\WObj:=wPart", "frame: the robot holds its work object"),
        (
            wobjdata("wPart", FRAME, 'FALSE,FALSE,"S1"'),
            "t\\WObj:=wPart",
            "frame: its work object moves with another mechanism",
        ),
    ],
)
def test_targets_in_frames_that_move_are_left_alone(data, use, why):
    text = module(data, f"CONST robtarget p1:={target(Q)};", "PROC main()", f"  MoveL p1,v100,fine,{use};")

    assert fixed(text).failures[0].why == why


def test_a_target_used_with_two_tools_is_left_alone():
    text = module(f"CONST robtarget p1:={target(Q)};", "MoveL p1,v100,fine,tool0;", "MoveL p1,v100,fine,tGun;")

    assert fixed(text).failures[0].why == "frame: it is used with more than one tool or work object"


def test_arrays_of_targets_are_corrected_one_by_one():
    second = Q + 0.05
    text = module(f"CONST robtarget pts{{2}}:=[{target(Q)},", f"    {target(second)}];")

    result = fixed(text)

    assert len(result.shift) == 2
    assert off(told(result, ",\n    "), base_T_tip(second), second)[0] < ROUND_MM


def test_absolute_joint_moves_are_corrected_and_other_lists_of_six_are_not():
    text = module(f"MoveAbsJ {joint_target(Q)}\\NoEOffs,v100,fine,tool0;", f"VAR mytype m:={joint_target(Q)};")

    result = fixed(text)

    assert len(result.shift) == 1
    assert off_joints(np.radians(read(result.after.decode(), "MoveAbsJ")[:6]), base_T_tip(Q))[0] < 0.01
    assert f"m:={joint_target(Q)};" in result.after.decode()


def test_targets_in_comments_and_strings_stay():
    text = module(f"! CONST robtarget p1:={target(Q)};", 'TPWrite "[[1,2,3],[1,0,0,0]";', "! [[")

    assert fixed(text).after == text.encode()


def test_targets_with_decimals_in_their_confdata_or_computed_are_named():
    text = module(
        f"CONST robtarget p1:={target(Q, conf=['0.0', 0, 0, 0])};",
        f"VAR robtarget p2:={target(Q).replace('[[', '[[dx+', 1)};",
    )

    result = fixed(text)

    assert result.after == text.encode()
    assert [(m.name, m.why.split(":")[0]) for m in result.mentions] == [("p1", "computed"), ("p2", "computed")]


def test_a_quaternion_that_is_no_orientation_is_left_alone():
    text = module(f"CONST robtarget p1:=[{listed(base_T_tip(Q)[:3, 3], 3)},[0.5,0,0,0],[0,0,0,0],{EAX}];")

    assert fixed(text).failures[0].why == "orientation: its quaternion has length 0.5, expected 1"


def test_confdata_decide_which_way_a_target_is_corrected():
    T = transform(CELL.theta[:6]) @ base_T_tip(Q)
    other = nominal(CELL.kinematics, CELL.theta, T[None], Q + np.array([0, 0, 0, np.pi, -1.8, np.pi]))[0][0]

    for q in (Q, other):
        command = told(fixed(module(f"CONST robtarget p1:={target(q, base_T_tip(Q))};")), "p1:=")
        assert off(command, base_T_tip(Q), q)[0] < ROUND_MM


def test_a_joint_that_leaves_its_quadrant_is_corrected_and_mentioned():
    q = Q.copy()
    q[3] = 0.001  # the correction takes it below zero

    result = fixed(module(f"CONST robtarget p1:={target(q)};"))

    assert len(result.shift) == 1
    assert any("posture flags" in mention.why for mention in result.mentions)


BROKEN = {
    "no module": ("MODULE", "PART", "expected MODULE: not a RAPID module"),
    "cut short": ("\nENDMODULE", "", "MODULE without ENDMODULE; is the file cut short?"),
    "bracket": (";\nENDMODULE", ";\nx:=[1,2;\nENDMODULE", "seam.mod:6: column 8: found"),
    "empty": ("[9E9,", "[,", "expected a value in the '[' of line 5"),
    "semicolon": ("],[9E9", ";[9E9", "seam.mod:5: column"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_module_is_refused_with_line_and_column(case):
    old, new, sentence = BROKEN[case]
    text = module(f"CONST robtarget p1:={target(Q)};")
    assert old in text

    with pytest.raises(InputError) as error:
        fixed(text.replace(old, new) if old == "MODULE" else text.replace(old, new, 1))

    assert sentence in str(error.value)
