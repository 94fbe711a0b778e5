"""FANUC programs: positions of all forms are corrected in place, and nothing but their numbers changes."""

import re

import numpy as np
import pytest
from fanuc_text import config, fixed, joint_text, number, pose_text, program, programs, read
from hypothesis import given, settings
from programs import AS_DRAWN, CELL, ROUND_DEG, ROUND_MM, TRUTH, Q, base_T_tip, from_wpr, off, off_joints

from identify.compensation.postures import nominal
from identify.model.files import InputError
from identify.model.frames import inverse, transform
from identify.model.joint_counting import JointCounting
from identify.programs.setup import Setup


def mistake(text):
    with pytest.raises(InputError) as error:
        fixed(text)
    return str(error.value)


@given(programs())
@settings(max_examples=12, phases=AS_DRAWN)
def test_corrected_positions_bring_the_true_robot_where_the_program_said(drawn):
    text, positions = drawn

    result = fixed(text)

    left = {mention.name for mention in result.failures}
    able = [i for i in range(1, len(positions) + 1) if f"P[{i}]" not in left]
    if left:  # no motion stands there: every position is of the path, which stays whole
        assert (result.after, len(result.shift), result.unchanged, result.whole) == (result.before, 0, len(able), False)
        if not able:
            return
        text = text.replace("/POS", f"   2:L P[{able[0]}] 100mm/sec FINE ;\n/POS")  # the path goes elsewhere
        result = fixed(text)
        assert {mention.name for mention in result.failures} == left
    assert (result.unchanged, result.whole) == (0, True)
    before, after = read(text), read(result.after.decode("latin-1"))
    assert len(after) == len(positions)
    for i, (kind, q, *_) in enumerate(positions):
        old, new = before[i], after[i]
        assert {k: v for k, v in old.items() if k != 1} == {k: v for k, v in new.items() if k != 1}
        if kind == "untaught" or f"P[{i + 1}]" in left:
            assert old == new
        elif kind == "joints":
            told = np.radians([new[1][f"J{j}"] for j in range(1, 7)])
            told[2] += told[1]
            assert off_joints(told, base_T_tip(q))[0] < 0.05  # a thousandth of a degree, in and out
        else:
            wanted, told = (from_wpr(np.array([v[1][k] for k in "XYZRPW"])) for v in (old, new))
            error = off(told, wanted, q)
            assert error[0] < ROUND_MM
            assert error[1] < ROUND_DEG
    assert len(result.shift) + len(left) == len(positions)
    assert sum(kind == "untaught" for kind, *_ in positions) <= len(left)


@given(programs())
@settings(max_examples=12, phases=AS_DRAWN)
def test_nothing_but_numbers_of_the_first_group_changes_and_columns_stay(drawn):
    text, _ = drawn

    after = fixed(text).after.decode("latin-1")

    blank = re.compile(r"(?<== )[ ]*-?\d*\.\d+(?= )")
    assert blank.sub("#", after) == blank.sub("#", text)
    assert [len(line) for line in after.splitlines()] == [len(line) for line in text.splitlines()]


def test_numbers_below_one_are_written_without_their_zero():
    T = base_T_tip(Q)
    T[2, 3] = base_T_tip(Q, TRUTH)[2, 3]  # a correction of some 8 mm
    near_zero = transform(np.array([0, 0, T[2, 3] + 8.2, 0, 0, 0]))  # a user frame in which Z comes out small

    result = fixed(program([pose_text(Q, 1, 1, inverse(near_zero) @ base_T_tip(Q))]), setup=Setup({"1": near_zero}))

    assert re.search(r"Z = +-?\.\d{3} ", result.after.decode()) or abs(read(result.after.decode())[0][1]["Z"]) >= 1


def test_user_frames_and_tools_of_the_table_are_heeded():
    base_T_frame = from_wpr(np.array([500.0, -100.0, 200.0, 30.0, -10.0, 5.0]))
    flange_T_tool = transform(CELL.theta[-6:]) @ from_wpr(np.array([0.0, 5.0, 20.0, 0.0, 15.0, 0.0]))
    tip_T_tool = inverse(transform(CELL.theta[-6:])) @ flange_T_tool
    written = inverse(base_T_frame) @ base_T_tip(Q) @ tip_T_tool
    text = program([pose_text(Q, 4, 7, written)])

    result = fixed(text, setup=Setup({"4": base_T_frame}, {"7": flange_T_tool}))

    new = read(result.after.decode())[0][1]
    told = base_T_frame @ from_wpr(np.array([new[k] for k in "XYZRPW"])) @ inverse(tip_T_tool)
    assert off(told, base_T_tip(Q), Q)[0] < 2 * ROUND_MM
    assert result.mentions == ()


def test_frames_without_a_table_are_the_base_and_that_is_said():
    result = fixed(program([pose_text(Q, 4, 7)]))

    assert len(result.shift) == 1
    assert [text.split(";")[0] for text in result.assumed] == [
        "frame 4 is taken for the robot's base",
        "tool 7 is taken for the cell's tool",
    ]


def test_a_frame_that_the_table_does_not_have_leaves_the_whole_path_as_it_is():
    text = program([pose_text(Q, 4), pose_text(Q, 5)])

    result = fixed(text, setup=Setup({"5": np.eye(4)}))

    assert [(m.name, m.line, m.why) for m in result.failures] == [("P[1]", 6, "frame: frame 4 is not in the table")]
    assert (len(result.shift), result.unchanged, result.whole) == (0, 1, False)
    assert result.after == result.before


def test_frame_0_is_the_base_and_tool_0_the_flange_whatever_the_table_says():
    flange = base_T_tip(Q) @ inverse(transform(CELL.theta[-6:]))

    result = fixed(program([pose_text(Q, 0, 0, flange)]), setup=Setup({"0": np.ones((4, 4))}))

    new = read(result.after.decode())[0][1]
    told = from_wpr(np.array([new[k] for k in "XYZRPW"])) @ transform(CELL.theta[-6:])
    assert off(told, base_T_tip(Q), Q)[0] < 0.02  # orientation rounded at a lever of 410 mm


def test_position_registers_offsets_and_coordinated_motions_are_named():
    motions = (
        "   1:J PR[7:home] 100% FINE    ;\n   2:L P[1] 50mm/sec CNT10 Offset,PR[3]    ;\n"
        "   3:L P[1] 50mm/sec FINE Tool_Offset,PR[4]    ;\n   4:L P[1] 50mm/sec FINE VOFFSET,VR[1] COORD ;"
    )

    mentions = fixed(program([pose_text(Q)], motions)).mentions

    assert [(m.line, m.name, m.why.split(":")[0]) for m in mentions[:5]] == [
        (5, "PR[7]", "position register"),
        (6, "P[1]", "offset"),
        (7, "P[1]", "offset"),
        (8, "P[1]", "offset"),
        (8, "P[1]", "coordinated"),
    ]


def test_a_position_used_incrementally_is_left_alone():
    result = fixed(program([pose_text(Q), pose_text(Q)], "   1:L P[2] 50mm/sec FINE INC    ;"))

    assert [(m.name, m.why.split(":")[0]) for m in result.failures] == [("P[2]", "incremental")]


def test_another_group_can_be_the_robot():
    text = program([pose_text(Q)]).replace("GP1:", "GP2:")

    assert fixed(text).after == text.encode()
    assert fixed(text).mentions[0].name == "GP2"
    assert len(fixed(text, setup=Setup(group=2)).shift) == 1


def test_joint_3_is_counted_against_the_horizontal_unless_the_table_says_otherwise():
    plain = "\tUF : 0, UT : 1,\n\t" + ",\t".join(f"J{i + 1}= {number(v)} deg" for i, v in enumerate(np.degrees(Q)))

    for text, setup in ((joint_text(Q), None), (plain, Setup(coupled=False))):
        new = read(fixed(program([text]), setup=setup).after.decode())[0][1]
        told = np.radians([new[f"J{j}"] for j in range(1, 7)])
        told[2] += told[1] if setup is None else 0
        assert off_joints(told, base_T_tip(Q))[0] < 0.05


def test_signs_and_zeros_of_the_table_are_heeded():
    sign, zero = np.array([1, -1, 1, -1, 1, -1.0]), np.array([0, 90, 0, 10, 0, 0.0])
    shown = sign * np.degrees(Q) + zero
    text = "\tUF : 0, UT : 1,\n\t" + ",\t".join(f"J{i + 1}= {number(v)} deg" for i, v in enumerate(shown))

    result = fixed(program([text]), setup=Setup(joints=JointCounting(tuple(sign), tuple(zero)), coupled=False))

    new = np.array(list(read(result.after.decode())[0][1].values()))
    assert off_joints(np.radians(sign * (new - zero)), base_T_tip(Q))[0] < 0.05


def test_the_posture_of_the_flags_decides_which_way_a_position_is_corrected():
    T = transform(CELL.theta[:6]) @ base_T_tip(Q)
    flipped = Q + np.array([0, 0, 0, np.pi, -1.8, np.pi])
    other = nominal(CELL.kinematics, CELL.theta, T[None], flipped)[0][0]
    assert other[4] < 0

    for q in (Q, other):
        text = program([pose_text(q, T=base_T_tip(Q))])
        new = read(fixed(text).after.decode())[0][1]
        assert off(from_wpr(np.array([new[k] for k in "XYZRPW"])), base_T_tip(Q), q)[0] < ROUND_MM


def test_flags_that_no_solution_has_leave_the_position_alone_and_name_the_cure():
    text = program([pose_text(Q).replace(config(Q), "'N U B, 0, 0, 0'")])

    result = fixed(text)

    assert result.after == text.encode()
    assert "signs and zeros" in result.failures[0].why
    assert len(fixed(text, setup=Setup(posture="nearest", near=Q)).shift) == 1


def test_a_joint_that_would_pass_half_a_turn_against_its_flag_is_left_alone():
    q = Q.copy()
    q[5] = -np.pi + 0.02

    result = fixed(program([pose_text(q)]))

    assert result.failures[0].why.split(":")[0] in {"joint limit", "posture"}


def test_joints_of_another_robot_are_left_alone():
    seven = joint_text(Q) + ",\tJ7=     0.000 deg"

    assert fixed(program([seven])).failures[0].why == "joints: it has 7, the robot of the calibration 6"


def test_a_position_without_one_of_its_numbers_is_left_alone():
    text = program([re.sub(r",\tR = +\S+ deg", "", pose_text(Q))])

    assert fixed(text).failures[0].why == "missing: no R"


BROKEN = {
    "no program": ("/PROG", "/PROGRAM", "seam.ls:1: column 1: found '/PROGRAM'"),
    "cut short": ("/END\n", "", "expected a position P[n]{ or /END"),
    "no positions": ("/POS", "/PAS", "the program has no /POS; is it cut short?"),
    "bracket": ("};", "}", "seam.ls:11: column 1: found '}', expected GPn: or };"),
    "number": ("mm,\tY", "mm,\tY = 1,2  mm,\tY", "seam.ls:9: column 27: found '2'"),
    "word": ("UF : 0, UT", "UF : zero, UT", "seam.ls:8: column 2: found 'UF'"),
    "letters": ("deg,\tP = ", "deg,\tP = x", "expected a number for P"),
    "twice": ("mm,\tY =", "mm,\tX =", "X stands twice in one position"),
    "posture": ("CONFIG : 'F", "CONFIG : F", "seam.ls:8: column 19"),
    "UTF-16": ("/PROG", "\0/PROG", "not a text of single bytes"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_program_is_refused_with_line_and_column(case):
    old, new, sentence = BROKEN[case]
    text = program([pose_text(Q)])
    assert old in text

    assert sentence in mistake(text.replace(old, new, 1) if case != "cut short" else text.replace(old, new))


def test_a_motion_to_a_position_that_is_not_there_leaves_the_path_as_it_is():
    text = program([joint_text(Q)], motions="   1:L P[1] 100mm/sec FINE ;\n   2:L P[7] 100mm/sec FINE ;")

    result = fixed(text)

    assert [(mention.name, mention.why.split(":")[0]) for mention in result.failures] == [("P[7]", "absent")]
    assert (result.unchanged, result.whole, result.after) == (1, False, result.before)
