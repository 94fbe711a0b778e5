"""Yaskawa jobs: positions are corrected under the headers that hold for them, pulses where their number is known."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from programs import AS_DRAWN, CELL, FRAME, ROUND_DEG, ROUND_MM, SAME, Q, base_T_tip, from_wpr, off, off_joints
from yaskawa_text import PULSES, SETUP, fixed, job, pose, programs, pulses, rconf, read, told

from identify.model.files import InputError
from identify.model.frames import inverse, transform
from identify.programs.setup import Setup


@given(programs(most=1))  # a path of one position: it is corrected, or left with its path
@settings(max_examples=25, phases=AS_DRAWN)
def test_corrected_positions_bring_the_true_robot_where_the_job_said(drawn):
    text, positions = drawn

    result = fixed(text, setup=SETUP)

    after, left = result.after.decode("latin-1"), {mention.name for mention in result.failures}
    for i, (kind, q) in enumerate(positions):
        name = f"C{i:05d}"
        old, new = read(text, name), read(after, name)
        assert kind != "tool" or name in left
        if name in left:
            assert np.array_equal(old, new)
        elif kind not in {"pulse", "angle"} and q[4] < 0:
            assert not np.array_equal(old, new)  # another wrist than the one that near_deg means
        elif kind in {"pulse", "angle"}:
            degrees = new / PULSES if kind == "pulse" else new
            assert off_joints(np.radians(degrees), base_T_tip(q))[0] < 0.03  # a pulse is a thousandth of a degree
        else:
            base_T_frame = FRAME if kind == "user" else np.eye(4)
            a, b = (from_wpr(v[[0, 1, 2, 5, 4, 3]]) for v in (new, old))
            error = off(base_T_frame @ a, base_T_frame @ b, q)
            assert error[0] < ROUND_MM
            assert error[1] < ROUND_DEG
            assert np.array_equal(old[6:], new[6:])


@given(programs())
@settings(max_examples=12, phases=AS_DRAWN)
def test_nothing_but_numbers_of_positions_changes(drawn):
    text = drawn[0]

    after = fixed(text, setup=SETUP).after.decode("latin-1")

    rows = [re.split(r"(?<=\n)", whole) for whole in (text, after)]
    for old, new in zip(*rows, strict=True):
        assert old == new or re.sub(r"-?[\d.]+", "#", old) == re.sub(r"-?[\d.]+", "#", new)
        assert old == new or old.startswith("C0")


def test_headers_hold_during_and_after():
    second = Q + 0.05
    T = [inverse(FRAME) @ base_T_tip(q) for q in (Q, second)]
    text = job(
        "///USER 4",
        "///TOOL 1",
        "///POSTYPE USER",
        "///RECTAN",
        rconf(Q),
        f"C00000={pose(Q, T[0])}",
        f"C00001={pose(second, T[1])}",
        "///POSTYPE BASE",
        f"C00002={pose(Q)}",
    )

    result = fixed(text, setup=SETUP)

    for name, q, frame in (("C00000", Q, FRAME), ("C00001", second, FRAME), ("C00002", Q, np.eye(4))):
        assert off(frame @ told(result, name), base_T_tip(q), q)[0] < ROUND_MM


def test_without_a_posture_to_look_from_a_position_is_left_alone_where_its_two_wrists_differ():
    text = job("///TOOL 1", "///POSTYPE ROBOT", "///RECTAN", rconf(Q), f"C00000={pose(Q)}")

    assert re.match(r"posture: several fit, [\d.]+ mm apart when corrected", fixed(text, setup=Setup()).failures[0].why)
    assert fixed(text, SAME, Setup()).failures == ()
    assert len(fixed(text, setup=Setup(near=Q)).shift) == 1


def test_tools_of_the_table_are_heeded():
    flange_T_tip = transform(CELL.theta[-6:])
    flange_T_tool = flange_T_tip @ from_wpr(np.array([0.0, 5.0, 20.0, 0.0, 15.0, 0.0]))
    text = job(
        "///TOOL 3",
        "///POSTYPE ROBOT",
        "///RECTAN",
        rconf(Q),
        f"C00000={pose(Q, base_T_tip(Q) @ inverse(flange_T_tip) @ flange_T_tool)}",
    )

    result = fixed(text, setup=Setup(tools={"3": flange_T_tool}, near=Q))

    command = told(result, "C00000") @ inverse(flange_T_tool) @ flange_T_tip
    assert off(command, base_T_tip(Q), Q)[0] < 2 * ROUND_MM


def test_pulses_without_their_number_a_degree_are_left_alone_and_say_what_is_missing():
    result = fixed(job("///TOOL 1", "///POSTYPE PULSE", "///PULSE", f"C00000={pulses(Q)}"))

    assert result.failures[0].why == (
        "pulses: their number a degree is not known; write joints: {pulses_per_deg: [...]} in cell.yaml"
    )


def test_position_variables_are_left_alone_unless_the_table_says_otherwise():
    text = job(
        "///TOOL 1",
        "///POSTYPE BASE",
        "///RECTAN",
        rconf(Q),
        f"P00001={pose(Q)}",
        instructions=("MOVL P001 V=10.0", "SFTON P010", "IMOV P002 V=5.0"),
    )

    result = fixed(text)

    assert result.after == text.encode()
    assert result.failures[0].why.startswith("position variable")
    assert [m.why.split(":")[0] for m in result.mentions] == ["position variable", "offset", "position variable"]
    assert len(fixed(text, setup=Setup(position_variables=True, near=Q)).shift) == 1


def test_positions_of_stations_and_tracks_stay():
    text = job("///POSTYPE PULSE", "///PULSE", "BC00000=1,2,3", "EC00000=4,5", "///POSTYPE ANGLE", "EX00000=20.7,5.3")

    assert fixed(text, setup=SETUP).after == text.encode()


def test_bytes_of_other_encodings_stay():
    text = job("///TOOL 1", "///POSTYPE ROBOT", "///RECTAN", rconf(Q), f"C00000={pose(Q)}").encode()
    text = text.replace(b"//NAME SEAM", b"//NAME \x83\x65\x83\x58\x83\x67\x5b") + b"\x1a"

    result = fixed(text)

    assert len(result.shift) == 1
    assert result.after.split(b"C00000=")[0] == text.split(b"C00000=")[0]
    assert result.after.endswith(b"END\n\x1a")


def test_numbers_padded_with_zeros_stay_padded():
    padded = ",".join(f"{'-' if float(v) < 0 else ''}{abs(float(v)):011.6f}" for v in pose(Q).split(","))

    after = fixed(job("///TOOL 1", "///POSTYPE ROBOT", "///RECTAN", rconf(Q), f"C00000={padded}")).after.decode()

    cells = next(row for row in after.splitlines() if row.startswith("C0")).split("=")[1].split(",")
    assert all(re.fullmatch(r"-?\d{4}\.\d{6}", cell) for cell in cells)


BROKEN = {
    "no job": ("/JOB", "/JAB", "expected /JOB: not a Yaskawa job"),
    "cut short": ("\nEND\n", "\n", "the job has no //INST or no END; is it cut short?"),
    "no instructions": ("//INST", "//INTS", "the job has no //INST or no END"),
    "letters": ("C00000=", "C00000=x", "SEAM.JBI:9: column 8: found 'x"),
    "too few": (",0.0,", ",", "C00000 has 5 numbers, expected X, Y, Z, Rx, Ry, Rz"),
    "semicolon": (",0.0,", ";0.0,", "expected a comma or the end of the line"),
    "no position": ("C00000=", "CXXXXX=", "SEAM.JBI:9: column 1: found"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_job_is_refused_with_line_and_column(case):
    old, new, sentence = BROKEN[case]
    text = job("///TOOL 1", "///POSTYPE ROBOT", "///RECTAN", rconf(Q), "C00000=500.0,100.0,0.0,180.0,10.0,20.0")
    assert old in text

    with pytest.raises(InputError) as error:
        fixed(text.replace(old, new, 1))

    assert sentence in str(error.value)
