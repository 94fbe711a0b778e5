"""`touchcal fix` as a user meets it: copies, differences, and programs that cannot be corrected."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from identified import JOB, identified

from identify.model.files import InputError
from identify.programs.fixing import fix
from identify.programs.makers import MAKERS


def test_fix_writes_copies_and_a_diff_and_says_what_it_left(project, touchcal):
    code, out, _ = touchcal("fix", "calibration.json", "SEAM.JBI", "-o", "out", "--diff")

    assert code == 0
    assert "SEAM.JBI: 1 of 2 positions corrected, by" in out
    assert "cannot be corrected: 1 pulses" in out
    assert "line 11, C00001: pulses: their number a degree is not known" in out
    assert "-C00000=5.0000,10.0000" in out
    assert "the base was found 1.70 mm and 2.37 degrees from where the cell file puts it" in out
    assert (project / "SEAM.JBI").read_text() == JOB
    changed = (project / "out" / "SEAM.JBI").read_text().splitlines()
    assert [i for i, line in enumerate(JOB.splitlines()) if line != changed[i]] == [7]
    assert (project / "out" / "corrections.diff").read_text().startswith("--- a/SEAM.JBI\n+++ b/SEAM.JBI\n@@")


def test_fix_reads_a_table_of_frames_and_joints(project, touchcal):
    (project / "setup.yaml").write_text("joints: {pulses_per_deg: [1000, 1000, 1000, 1000, 1000, 1000]}\n")

    told = json.loads(touchcal("fix", "calibration.json", "SEAM.JBI", "--setup", "setup.yaml", "--json")[1])

    assert told["SEAM.JBI"]["left"] == [] or "pulses" not in told["SEAM.JBI"]["left"][0]["why"]
    assert told["SEAM.JBI"]["shift_mm"]["max"] > 1


def test_fix_leaves_the_place_of_the_base_aside_where_points_stand_with_the_robot(project, touchcal):
    (project / "setup.yaml").write_text("fixed_to: robot\n")

    code, out, _ = touchcal("fix", "calibration.json", "SEAM.JBI", "--setup", "setup.yaml")

    assert code == 0
    assert "the base was found" not in out


def test_a_program_that_cannot_be_corrected_whole_gets_no_copy(project, touchcal):
    (project / "GAP.JBI").write_text(JOB.replace("C00000 V", "C00007 V"))

    code, out, _ = touchcal("fix", "calibration.json", "GAP.JBI", "SEAM.JBI", "-o", "out")

    assert code == 1
    assert "GAP.JBI: not corrected and not written" in out
    assert "C00007: absent: a motion goes there, and the program holds no such position" in out
    assert sorted(path.name for path in (project / "out").iterdir()) == ["SEAM.JBI", "corrections.diff"]


def test_fix_writes_nothing_when_one_program_is_broken(project, touchcal):
    (project / "BROKEN.JBI").write_text(JOB.replace("C00000=5", "C00000=x5"))

    code, out, err = touchcal("fix", "calibration.json", "SEAM.JBI", "BROKEN.JBI", "-o", "out")

    assert (code, out) == (2, "")
    assert "BROKEN.JBI:8: column 8: found 'x5.0000', expected a number" in err
    assert not (project / "out").exists()


@given(data=st.binary(max_size=200))
@settings(max_examples=30)
def test_any_bytes_that_call_themselves_a_program_are_answered(data, arc_welder):
    calibration = identified(arc_welder, arc_welder.theta)
    for suffix in MAKERS:
        try:
            after = fix(calibration, {f"p{suffix}": data})[0].after
        except InputError as error:
            after = data if str(error).startswith(f"p{suffix}") else b""
        assert after == data


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["fix", "calibration.json"], "nothing to correct: name at least one program"),
        (["fix", "calibration.json", "none.LS"], "none.LS: no such file"),
        (["fix", "calibration.json", "poses.csv"], "poses.csv: not a program of a maker that is known"),
        (["fix", "calibration.json", "SEAM.JBI", "-o", "."], "SEAM.JBI stands there; choose another folder with -o"),
        (["fix", "calibration.json", "SEAM.JBI", "./SEAM.JBI"], "two programs have the same name"),
        (["fix", "calibration.json", "SEAM.JBI", "--setup", "none.yaml"], "none.yaml: no such file"),
        (["fix", "calibration.json", "SEAM.JBI", "-o", "poses.csv"], "poses.csv: cannot be made"),
    ],
)
def test_bad_input_gets_one_sentence_and_exit_code_2(arguments, sentence, project, touchcal):
    before = sorted(project.rglob("*"))

    code, out, err = touchcal(*arguments)

    assert (code, out) == (2, "")
    assert sentence in err
    assert "Traceback" not in err
    assert sorted(project.rglob("*")) == before
