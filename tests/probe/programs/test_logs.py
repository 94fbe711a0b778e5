"""Readers of logs: number forms, and every bad input answered with file, line and cure."""

import re
import socket
import threading
from dataclasses import replace

import numpy as np
import pytest
from fanuc_tp import bare
from hypothesis import given
from hypothesis import strategies as st
from kuka_krl import shown
from maker_bench import Bench, make

from identify.model.files import InputError
from probe.programs import fanuc, kuka, ur
from probe.programs.evidence import imported
from probe.programs.log import STAMPS, stamp
from probe.programs.makers import MAKERS, read_logs
from probe.programs.options import Options
from probe.programs.part import folded, joined

FEW = 3
ANGLES = st.lists(st.floats(-360, 360), min_size=6, max_size=6).map(np.array)


@pytest.fixture(scope="module")
def few(bench) -> Bench:
    return replace(bench, plan=bench.plan.take(np.arange(FEW)))


@pytest.fixture(scope="module")
def logs(few, tmp_path_factory) -> dict[str, dict[str, str]]:
    """What three touches of each maker left."""
    return {maker: make(few, maker, tmp_path_factory.mktemp(maker), Options()).logs for maker in MAKERS}


def reading(few, maker, files, folder):
    paths = []
    for name, text in files.items():
        paths.append(folder / name)
        paths[-1].write_text(text, newline="")
    return imported(
        read_logs(paths, few.plan, few.cell, maker), few.plan, few.cell, maker, straight=MAKERS[maker].straight
    )


@given(ANGLES)
def test_fanuc_numbers_are_read_as_the_controller_writes_them(counts):
    text = "[*POSREG*]$POSREG  Storage: CMOS  Access: RW  : ARRAY[1,1] OF Position Reg\n    [1,1] =   ''   Group: 1\n"
    text += "  " + "   ".join(f"J{k + 1} = {bare(value):>9s} deg" for k, value in enumerate(counts)) + " \n\n"

    found = fanuc._elements(text, "POSREG")

    values = [float(match[2]) for match in fanuc.JOINT.finditer(found[1][1])]
    np.testing.assert_allclose(values, counts, atol=0.00051)


@given(ANGLES)
def test_kuka_axes_are_read_as_the_data_list_shows_them(counts):
    text = shown({f"A{k + 1}": float(value) for k, value in enumerate(counts)} | {"E1": 0.0})

    values = [float(match[2]) for match in kuka.AXIS.finditer(text)]

    np.testing.assert_allclose(values, counts, atol=6e-6)


@given(ANGLES, st.integers(0, 7))
def test_joints_are_written_with_their_decimals_and_never_as_minus_nothing(counts, decimals):
    text = joined(counts, decimals)

    np.testing.assert_allclose([float(word) for word in text.split(",")], counts, atol=0.51 * 10.0**-decimals)
    assert not re.search(r"-0(\.0*)?(,|$)", text)
    assert "e" not in text


@given(st.text(st.characters(codec="ascii", categories=["L", "N"]), max_size=30), st.integers(32, 60))
def test_remarks_are_folded_to_their_width_and_lose_no_word(word, width):
    text = f"{word} and then some words more than fit into a line, {word}"

    lines = list(folded(text, width))

    assert all(len(line) <= width for line in lines)
    assert " ".join(lines).split() == text.split()


def test_stamps_tell_plans_and_makers_apart(few, bench):
    stamps = {stamp(plan, few.cell.robot, maker) for plan in (few.plan, bench.plan) for maker in MAKERS}

    assert len(stamps) == 2 * len(MAKERS)
    assert all(STAMPS[0] <= number < sum(STAMPS) for number in stamps)


@pytest.mark.parametrize("maker", MAKERS)
def test_the_log_of_another_plan_is_refused(maker, few, logs, bench, tmp_path):
    other = replace(few, plan=bench.plan.take(np.arange(1, 1 + FEW)))

    with pytest.raises(InputError, match=r"another plan|the stamp of this plan"):
        reading(other, maker, logs[maker], tmp_path)


def test_positions_of_a_yaskawa_may_stand_in_a_job(few, logs, tmp_path):
    text = logs["yaskawa"]["VAR1.DAT"]
    head, _, slots = text.partition("///P\r\n")
    pulses = [line.split(",")[6:12] for line in slots.splitlines() if line.startswith('"PULSE"')]
    places = "".join(f"P{k:05d}={','.join(values)}\r\n" for k, values in enumerate(pulses))
    job = f"/JOB\r\n//NAME X\r\n//POS\r\n///NPOS 0,0,0,6,0,0\r\n///PULSE\r\n{places}//INST\r\nNOP\r\nEND\r\n"

    apart = reading(few, "yaskawa", {"VAR.DAT": head, "X.JBI": job}, tmp_path)

    np.testing.assert_array_equal(apart.touches.q, reading(few, "yaskawa", logs["yaskawa"], tmp_path).touches.q)
    with pytest.raises(InputError, match="P000 is not in it; load a job that names it"):
        reading(few, "yaskawa", {"VAR.DAT": head}, tmp_path)


BAD = [
    ("fanuc", "numreg1.va", lambda t: t.replace("*NUMREG*", "*OTHER*"), r"numreg1.va:1: no \[\*POSREG\*\]"),
    ("fanuc", "numreg1.va", lambda t: t.replace("[11] = 1", "[11] = one"), r"numreg1.va:12: R\[11\] is 'one"),
    ("fanuc", "posreg1.va", lambda t: re.sub(r"J1 = .*? J2", "X: 1.0 J2", t), r"PR\[4\] does not hold joints"),
    (
        "fanuc",
        "posreg1.va",
        lambda t: re.sub(r"\[1,4\] =.*?\n\n", "[1,4] =   '' Uninitialized\n", t, flags=re.S),
        "touch 1 has a contact but no joints",
    ),
    ("kuka", "TC1.dat", lambda t: t.replace("TC_STAMP", "TC_X"), "no TC_STAMP in it; give the .dat"),
    ("kuka", "TC1.dat", lambda t: re.sub(r"TC_Q\[2\]=\{A1 \S+,", "TC_Q[2]={", t), r"TC1.dat:\d+: TC_Q\[2\] is"),
    ("kuka", "TC1.dat", lambda t: t.replace("TC_S[1]=1", "TC_S[1]=9"), r"TC1.dat:\d+: touch 1 has code 9"),
    ("kuka", "TC1.dat", lambda t: re.sub(r"TC_COUNT=\d+", "TC_COUNT=4", t), r"TC_S\[4\] is missing; give the whole"),
    ("abb", "tc1.txt", lambda t: t[: t.rindex("\n", 0, -1) + 15], r"tc1.txt:7: found 'r 3 .*is the line cut short"),
    ("abb", "tc1.txt", lambda t: "", "no line 'touchcal ...' in it"),
    ("abb", "tc1.txt", lambda t: re.sub(r"touchcal \d+", "touchcal 12", t), r"tc1.txt:1: its header is"),
    ("yaskawa", "VAR1.DAT", lambda t: t.replace("///B", "///X"), "no section ///B in it"),
    (
        "yaskawa",
        "VAR1.DAT",
        lambda t: re.sub(r'(///P\s+"PULSE"(?:\d*,){6})', r"\g<1>1.5,", t),
        r"VAR1.DAT:\d+: P000 is .*pulses",
    ),
    ("ur", "TC1.log", lambda t: t.replace("t 1", "x 1"), r"TC1.log:2: found 'x 1"),
    ("ur", "TC1.log", lambda t: re.sub(r" 3 5000", " 3 0", t), "TC1.log:1: its header is"),
]


@pytest.mark.parametrize(("maker", "name", "spoil", "words"), BAD)
def test_a_spoiled_log_is_answered_with_its_file_its_line_and_the_cure(maker, name, spoil, words, few, logs, tmp_path):
    assert spoil(logs[maker][name]) != logs[maker][name]

    with pytest.raises(InputError) as error:
        reading(few, maker, logs[maker] | {name: spoil(logs[maker][name])}, tmp_path)

    assert re.search(words, str(error.value)), str(error.value)


def test_half_of_a_fanuc_log_is_asked_for(few, logs, tmp_path):
    with pytest.raises(InputError, match=r"1 posreg.va and 0 numreg.va are given"):
        reading(few, "fanuc", {"posreg1.va": logs["fanuc"]["posreg1.va"]}, tmp_path)


@pytest.mark.parametrize("ending", ["end", "hang up"])
def test_a_stream_is_read_until_the_robot_says_end_or_hangs_up(ending, logs):
    sent, said = logs["ur"]["TC1.log"], []
    heard: list[str] = []
    ready = threading.Event()

    def progress(text: str) -> None:
        said.append(text)
        ready.set()

    listener = threading.Thread(target=lambda: heard.append(ur.listen("127.0.0.1", 0, progress)))
    listener.start()
    ready.wait(10)
    port = int(re.search(r"port (\d+)", said[0])[1])
    with socket.create_connection(("127.0.0.1", port)) as robot:
        text = sent if ending == "end" else sent[: sent.rindex("end") - 5]
        robot.sendall(text.encode())
        if ending == "end":
            listener.join(10)
    listener.join(10)

    assert heard == [sent if ending == "end" else sent[: sent.rindex("\nr") + 1]]
