"""KUKA programs: structures of all kinds are corrected in place, with the tool and base that the program says."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from kuka_text import axes, dat, fixed, pose, programs, read, src, told
from programs import AS_DRAWN, CELL, EXACT, FRAME, ROUND_DEG, ROUND_MM, Q, base_T_tip, from_wpr, off, off_joints

from identify.compensation.postures import nominal
from identify.model.files import InputError
from identify.model.frames import inverse, transform
from identify.programs.fixing import fix
from identify.programs.setup import Setup


@given(programs(most=1))  # a path of one position: it is corrected, or left with its path
@settings(max_examples=25, phases=AS_DRAWN)
def test_corrected_positions_bring_the_true_robot_where_the_program_said(drawn):
    text, positions = drawn

    result = fixed(text)

    after, left = (
        result.after.decode("latin-1"),
        {mention.name: mention.why.split(":")[0] for mention in result.failures},
    )
    for i, (kind, q) in enumerate(positions):
        old, new = read(text, f"XP{i}="), read(after, f"XP{i}=")
        expected = {"missing": "missing", "accurate": "absolute accuracy"}.get(kind)
        guarded = {None, "near a singularity", "joint limit", "posture" if kind == "FRAME" else None}
        assert left.get(f"XP{i}") in ({expected} if expected else guarded)
        if f"XP{i}" in left:
            assert new == old
        elif kind == "E6AXIS":
            assert off_joints(np.radians([new[f"A{j}"] for j in range(1, 7)]), base_T_tip(q))[0] < 0.01
        else:
            a, b = (from_wpr(np.array([v[k] for k in "XYZABC"])) for v in (new, old))
            error = off(a, b, q)
            assert error[0] < ROUND_MM
            assert error[1] < ROUND_DEG


@given(programs())
@settings(max_examples=12, phases=AS_DRAWN)
def test_nothing_but_numbers_of_positions_changes(drawn):
    text = drawn[0]

    after = fixed(text).after.decode("latin-1")

    blank = re.compile(r"(?<=[XYZABC123456] )-?\d+\.\d+")
    assert blank.sub("#", after) == blank.sub("#", text)
    assert [line for line in after.splitlines() if "XP" not in line] == [x for x in text.splitlines() if "XP" not in x]


def test_decimals_are_kept_and_whole_numbers_get_three():
    text = dat(f"DECL POS XP1={pose(Q, digits=0)}", f"DECL POS XP2={pose(Q, digits=9)}")

    after = fixed(text).after.decode()

    digits = [[len(part) for part in re.findall(r"[XYZABC] -?\d+\.(\d+)", row)] for row in after.splitlines()[3:5]]
    assert digits == [[3, 3, 3, 4, 4, 4], [9] * 6]


def test_numbers_with_exponents_are_read_and_written():
    T = base_T_tip(Q)
    text = dat(f"DECL POS XP1={pose(Q, T)}").replace(f"Z {T[2, 3]:.6f}", f"Z {T[2, 3]:.9E}")

    result = fixed(text)

    assert off(told(result, "XP1"), T, Q)[0] < ROUND_MM


def test_base_and_tool_numbers_of_the_taught_data_are_heeded():
    flange_T_tool = transform(CELL.theta[-6:]) @ from_wpr(np.array([0.0, 5.0, 20.0, 0.0, 15.0, 0.0]))
    tip_T_tool = inverse(transform(CELL.theta[-6:])) @ flange_T_tool
    written = inverse(FRAME) @ base_T_tip(Q) @ tip_T_tool
    text = dat(
        f"DECL E6POS XWELD={pose(Q, written)}",
        'DECL FDAT FWeld={TOOL_NO 7,BASE_NO 4,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}',
    )

    result = fixed(text, setup=Setup({"4": FRAME}, {"7": flange_T_tool}))

    assert off(FRAME @ told(result, "XWELD") @ inverse(tip_T_tool), base_T_tip(Q), Q)[0] < 2 * ROUND_MM


def test_an_external_tool_is_left_alone():
    text = dat(f"DECL E6POS XP1={pose(Q)}", "DECL FDAT FP1={TOOL_NO 1,BASE_NO 1,IPO_FRAME #TCP}")

    assert fixed(text).failures[0].why.split(":")[0] == "frame"


@pytest.mark.parametrize(
    "setting", ["BAS(#BASE,4)", "$BASE=BASE_DATA[4]", "$BASE = {X 500,Y -100,Z 200,A 30,B -10,C 5}"]
)
def test_the_base_that_a_program_sets_holds_for_what_follows(setting):
    T = inverse(FRAME) @ base_T_tip(Q)
    inline = pose(Q, T, tail="")
    text = src(
        f"PTP {pose(Q, tail='')}", setting, f"LIN {inline} C_DIS", "LIN XOWN", "$BASE=$NULLFRAME", f"PTP {pose(Q)}"
    )
    points = dat(f"DECL E6POS XOWN={pose(Q, T)}")

    result = fixed(text, setup=Setup({"4": FRAME}), seam_dat=points)
    other = fixed(points, setup=Setup({"4": FRAME}), seam_src=text)

    assert len(result.shift) == 3
    assert off(FRAME @ told(result, "C_DIS"), base_T_tip(Q), Q)[0] < ROUND_MM
    assert off(FRAME @ told(other, "XOWN"), base_T_tip(Q), Q)[0] < ROUND_MM
    for line in ("PTP", ",E2"):
        assert off(told(result, line), base_T_tip(Q), Q)[0] < ROUND_MM
    if "{" in setting:
        assert setting in result.after.decode()  # the frame itself stays


def test_a_base_that_is_computed_leaves_what_follows_alone():
    result = fixed(src("$BASE=BASE_DATA[2]:SHIFT", f"LIN {pose(Q)}"))

    assert [mention.why.split(":")[0] for mention in result.failures] == ["frame"]
    assert result.mentions[0].why == "frame: it is computed while the program runs"


def test_a_position_used_with_two_bases_is_left_alone():
    text = src(f"XA={pose(Q)}", "BAS(#BASE,1)", "PTP XA", "BAS(#BASE,2)", "PTP XA")

    assert fixed(text).failures[0].why == "frame: it is used with more than one base or tool"


def test_inline_positions_of_circles_and_axes_are_corrected():
    second = Q + 0.05
    lines = (f"CIRC {pose(Q, tail='')},{pose(second, tail='')} C_DIS", f"PTP {axes(Q)}")

    result = fixed(src(*lines))
    with_a_gap = fixed(src(*lines, "PTP {A1 5.0}"))

    assert (len(result.shift), result.failures, result.whole) == (3, (), True)
    assert off(told(result, "CIRC"), base_T_tip(second), second)[0] < ROUND_MM
    assert [mention.why.split(":")[0] for mention in with_a_gap.failures] == ["missing"]
    assert (with_a_gap.unchanged, with_a_gap.whole, with_a_gap.after) == (3, False, with_a_gap.before)


def test_relative_motions_and_shifts_are_named_and_not_corrected():
    text = src(
        "LIN_REL {X 10.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}", f"DECL POS XP1={pose(Q)}", "LIN XP1:TURNED", "XP1.X=XP1.X+10"
    )

    result = fixed(text)

    assert [m.why.split(":")[0] for m in result.mentions] == ["incremental", "offset", "offset"]
    assert "LIN_REL {X 10.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}" in result.after.decode()


def test_frames_and_tools_stay_as_they_are():
    text = dat(
        "DECL FRAME BASE_SHIFT={X 500.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}",
        "BASE_DATA[1]={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}",
    )

    assert fixed(text).after == text.encode()


def test_components_that_are_computed_leave_the_position_alone():
    text = src(f"PTP {pose(Q).replace('X ', 'X WIDTH+')}")

    assert fixed(text).failures[0].why == "computed: X is no plain number"


@pytest.mark.parametrize("written", ["S 'B10010',T 'B000000'", "S 18,T 0", "S 'H12',T 0"])
def test_the_flag_of_absolute_accuracy_is_seen_however_it_is_written(written):
    text = dat(f"DECL POS XP1={re.sub(r'S [0-9]+,T [0-9]+', written, pose(Q))}")

    assert fixed(text).failures[0].why.startswith("absolute accuracy")


def test_the_turn_bits_decide_which_way_a_position_is_corrected():
    T = transform(CELL.theta[:6]) @ base_T_tip(Q)
    other = nominal(CELL.kinematics, CELL.theta, T[None], Q + np.array([0, 0, 0, np.pi, -1.8, np.pi]))[0][0]

    results = [told(fixed(dat(f"DECL POS XP1={pose(q, base_T_tip(Q))}")), "XP1") for q in (Q, other)]

    for q, command in zip((Q, other), results, strict=True):
        assert off(command, base_T_tip(Q), q)[0] < ROUND_MM
    assert np.abs(results[0] - results[1]).max() > 0.1  # the two wrists err differently


def test_capitals_do_not_matter():
    text = dat(f"decl e6pos xp1={pose(Q).lower()}").replace("DEFDAT", "defdat").replace("ENDDAT", "enddat")

    assert len(fix(EXACT, {"seam.dat": text.encode()})[0].shift) == 1


BROKEN = {
    "no program": (dat(), "DEFDAT", "DATA", "expected DEF or DEFDAT: not a KUKA program"),
    "cut short": (dat(), "ENDDAT", "", "DEFDAT without ENDDAT; is the file cut short?"),
    "open": (dat(f"DECL POS XP1={pose(Q)}"), "0.0}", "0.0", "seam.dat:4: column 14: a '{' that does not close"),
    "closed": (dat(f"DECL POS XP1={pose(Q)}"), "0.0}", "0.0}}", "a '}' that nothing has opened"),
    "twice": (dat(f"DECL POS XP1={pose(Q)}"), ",Y ", ",X ", "X stands twice in one structure"),
    "no value": (dat("DECL POS XP1={X 1.0,Y ,Z 2.0}"), "Y ,", "Y ,", "seam.dat:4: column 23: found "),
    "no name": (dat("DECL POS XP1={X 1.0,,Z 2.0}"), ",,", ",,", "expected the name of a component"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_program_is_refused_with_line_and_column(case):
    text, old, new, sentence = BROKEN[case]
    broken = text.replace(old, new, 1)

    with pytest.raises(InputError) as error:
        fix(EXACT, {"seam.dat": broken.encode()})

    assert sentence in str(error.value)
