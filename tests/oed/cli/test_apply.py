"""compensate, fix and export as a user meets them: what they say, what they write, what they answer to bad input."""

import csv
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from identified import identified, poses_at
from measured import table_2

from identify.model.files import InputError, sheet_text
from identify.model.frames import inverse, pose, transform
from identify.model.io.calibration_file import write_calibration
from identify.model.io.entries import POSE_KEYS, POSE_UNIT
from identify.programs.fixing import fix
from identify.programs.makers import MAKERS

Q = np.array([[0.1, 0.2, -0.3, 0.4, 0.9, 0.3], [0.2, 0.3, -0.4, 0.1, 1.0, -0.3], [0.1, 0.2, -0.3, 0.4, 0.8, 0.3]])
JOB = """/JOB
//NAME SEAM
//POS
///NPOS 2,0,0,0,0,0
///TOOL 1
///POSTYPE ANGLE
///ANGLE
C00000=5.0000,10.0000,-15.0000,20.0000,50.0000,-0.2500
///POSTYPE PULSE
///PULSE
C00001=1,2,3,4,5,6
//INST
NOP
MOVL C00000 V=10.0
END
"""


@pytest.fixture
def folder(arc_welder, tmp_path, monkeypatch):
    """A calibration, poses (the last one out of reach) and a job."""
    write_calibration(tmp_path / "calibration.json", identified(arc_welder, table_2(arc_welder)))
    values = poses_at(arc_welder, Q) / POSE_UNIT
    values[2, 0] += 5000
    columns = {"id": ["a", "b", "c"]} | dict(zip(POSE_KEYS, values.T, strict=True))
    (tmp_path / "poses.csv").write_text(sheet_text(columns))
    (tmp_path / "SEAM.JBI").write_text(JOB)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def rows(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def test_compensate_writes_joints_and_commands_and_names_what_it_left(folder, touchcal, arc_welder):
    code, out, _ = touchcal("compensate", "calibration.json", "poses.csv", "--near", "5,10,-15,20,50,15")

    assert code == 0
    assert "2 of 3 poses corrected" in out
    assert "c: out of reach" in out
    found = rows(folder / "corrected.csv")
    assert [row["status"] for row in found] == ["corrected", "corrected", "left"]
    for row, wanted in zip(found[:2], rows(folder / "poses.csv"), strict=False):
        q = np.radians([float(row[f"q{i}_deg"]) for i in range(1, 7)])
        true = poses_at(arc_welder, q[None], table_2(arc_welder))[0]
        told = np.array([float(row[k]) for k in POSE_KEYS]) * POSE_UNIT
        assert np.abs(true[:3] - [float(wanted[k]) for k in POSE_KEYS[:3]]).max() < 1e-3
        assert np.abs(transform(poses_at(arc_welder, q[None])[0]) - transform(told)).max() < 1e-5
    last = rows(folder / "poses.csv")[2]
    assert all(float(found[2][k]) == pytest.approx(float(last[k]), abs=1e-8) for k in POSE_KEYS)
    assert found[2]["q1_deg"] == ""


def test_compensate_counts_from_the_base_or_a_user_frame_where_it_is_told_to(folder, touchcal, arc_welder):
    base_T_user = np.array([500.0, -100, 200, 30, -10, 5]) * POSE_UNIT
    frame = transform(arc_welder.theta[:6]) @ transform(base_T_user)
    values = pose(inverse(frame) @ transform(poses_at(arc_welder, Q[:2]))) / POSE_UNIT
    columns = {"id": ["a", "b"]} | dict(zip(POSE_KEYS, values.T, strict=True))
    (folder / "user.csv").write_text(sheet_text(columns))

    touchcal("compensate", "calibration.json", "poses.csv", "--near", "5,10,-15,20,50,15", "-o", "jig.csv")
    code, _, err = touchcal("compensate", "calibration.json", "user.csv", "--near", "5,10,-15,20,50,15",
                            "--frame", "500,-100,200,30,-10,5", "-o", "user_out.csv")  # fmt: skip

    assert (code, err) == (0, "")
    for a, b in zip(rows(folder / "jig.csv"), rows(folder / "user_out.csv"), strict=False):
        assert float(a["q2_deg"]) == pytest.approx(float(b["q2_deg"]), abs=1e-6)


def test_compensate_tells_scripts_what_it_did(folder, touchcal):
    told = json.loads(touchcal("compensate", "calibration.json", "poses.csv", "--json")[1])

    assert told.keys() == {"poses", "corrected", "left", "shift_mm", "max_residual_mm"}
    assert told["poses"] == 3
    assert told["max_residual_mm"] < 1e-3


def test_compensate_can_be_told_how_far_joints_may_move(folder, touchcal):
    told = json.loads(touchcal("compensate", "calibration.json", "poses.csv", "--max-change-deg", "0.1", "--json")[1])

    assert told["corrected"] == 0
    assert told["shift_mm"] is None


def test_fix_writes_copies_and_a_diff_and_says_what_it_left(folder, touchcal):
    code, out, _ = touchcal("fix", "calibration.json", "SEAM.JBI", "-o", "out", "--diff")

    assert code == 0
    assert "SEAM.JBI: 1 of 2 positions corrected, by" in out
    assert "left as they are: 1 pulses" in out
    assert "line 11, C00001: pulses: their number a degree is not known" in out
    assert "-C00000=5.0000,10.0000" in out
    assert "the base was found 1.70 mm and 2.37 degrees from where the cell file puts it" in out
    assert (folder / "SEAM.JBI").read_text() == JOB
    changed = (folder / "out" / "SEAM.JBI").read_text().splitlines()
    assert [i for i, line in enumerate(JOB.splitlines()) if line != changed[i]] == [7]
    assert (folder / "out" / "corrections.diff").read_text().startswith("--- a/SEAM.JBI\n+++ b/SEAM.JBI\n@@")


def test_fix_reads_a_table_of_frames_and_joints(folder, touchcal):
    (folder / "setup.yaml").write_text("joints: {pulses_per_deg: [1000, 1000, 1000, 1000, 1000, 1000]}\n")

    told = json.loads(touchcal("fix", "calibration.json", "SEAM.JBI", "--setup", "setup.yaml", "--json")[1])

    assert told["SEAM.JBI"]["left"] == [] or "pulses" not in told["SEAM.JBI"]["left"][0]["why"]
    assert told["SEAM.JBI"]["shift_mm"]["max"] > 1


def test_fix_leaves_the_place_of_the_base_aside_where_points_stand_with_the_robot(folder, touchcal):
    (folder / "setup.yaml").write_text("fixed_to: robot\n")

    code, out, _ = touchcal("fix", "calibration.json", "SEAM.JBI", "--setup", "setup.yaml")

    assert code == 0
    assert "the base was found" not in out


def test_fix_writes_nothing_when_one_program_is_broken(folder, touchcal):
    (folder / "BROKEN.JBI").write_text(JOB.replace("C00000=5", "C00000=x5"))

    code, out, err = touchcal("fix", "calibration.json", "SEAM.JBI", "BROKEN.JBI", "-o", "out")

    assert (code, out) == (2, "")
    assert "BROKEN.JBI:8: column 8: found 'x5.0000', expected a number" in err
    assert not (folder / "out").exists()


@pytest.mark.parametrize("format", ["urdf", "ur-yaml", "dh-csv", "json", "mastering-text"])
def test_export_writes_files_and_says_what_the_format_costs(format, folder, touchcal):
    code, out, _ = touchcal("export", "calibration.json", "--format", format)
    told = json.loads(touchcal("export", "calibration.json", "--format", format, "-o", "other.x", "--json")[1])

    assert code == 0
    assert "read again, the tip is at most this far from the identified robot's" in out
    assert told["files"][0] == "other.x"
    assert all((folder / name).read_text() for name in told["files"])
    assert (told["deviation"]["max_mm"] < 1e-6) == (format != "mastering-text")


def test_export_corrects_the_urdf_that_it_wrote_itself_for_the_nominal_robot(folder, touchcal, arc_welder):
    write_calibration(folder / "nominal.json", identified(arc_welder, arc_welder.theta))
    touchcal("export", "nominal.json", "--format", "urdf", "-o", "arm.urdf")
    text = (folder / "arm.urdf").read_text().replace("touchcal_", "drawn_")
    (folder / "arm.urdf").write_text(text)

    code, out, _ = touchcal("export", "calibration.json", "--format", "urdf", "--urdf", "arm.urdf",
                            "--base", "base_link", "--flange", "flange")  # fmt: skip

    assert code == 0
    assert "identified robot's: nothing" in out
    assert 'name="drawn_tip"' in (folder / "calibrated.urdf").read_text()


@pytest.mark.parametrize(("arguments", "sentence"), [
    (["compensate", "calibration.json", "none.csv"], "none.csv: no such file"),
    (["compensate", "none.json", "poses.csv"], "none.json: no such file"),
    (["compensate", "poses.csv", "poses.csv"], "not a calibration"),
    (["compensate", "calibration.json", "calibration.json"], "column"),
    (["compensate", "calibration.json", "poses.csv", "--frame", "table"], "other than jig or base, is 'table'"),
    (["compensate", "calibration.json", "poses.csv", "--frame", "1,2,3"], "expected 6 numbers parted by commas"),
    (["compensate", "calibration.json", "poses.csv", "--near", "1,2"], "--near is '1,2', expected 6 numbers"),
    (["compensate", "calibration.json", "poses.csv", "-o", "no/such/folder.csv"], "cannot be written"),
    (["fix", "calibration.json"], "nothing to correct: name at least one program"),
    (["fix", "calibration.json", "none.LS"], "none.LS: no such file"),
    (["fix", "calibration.json", "poses.csv"], "poses.csv: not a program of a maker that is known"),
    (["fix", "calibration.json", "SEAM.JBI", "-o", "."], "SEAM.JBI stands there; choose another folder with -o"),
    (["fix", "calibration.json", "SEAM.JBI", "./SEAM.JBI"], "two programs have the same name"),
    (["fix", "calibration.json", "SEAM.JBI", "--setup", "none.yaml"], "none.yaml: no such file"),
    (["fix", "calibration.json", "SEAM.JBI", "-o", "poses.csv"], "poses.csv: cannot be made"),
    (["export", "calibration.json", "--format", "sdf"], "sdf"),
    (["export", "calibration.json", "--format", "urdf", "--urdf", "none.urdf"], "name the links of the chain"),
    (["export", "calibration.json", "--format", "urdf", "--urdf", "none.urdf", "--base", "a", "--flange", "b"],
     "none.urdf: no such file"),
])  # fmt: skip
def test_bad_input_gets_one_sentence_and_exit_code_2(arguments, sentence, folder, touchcal):
    before = sorted(folder.rglob("*"))

    code, out, err = touchcal(*arguments)

    assert (code, out) == (2, "")
    assert sentence in err
    assert "Traceback" not in err
    assert sorted(folder.rglob("*")) == before


POSES = "id,x_mm,y_mm,z_mm,rz_deg,ry_deg,rx_deg\n"


@pytest.mark.parametrize(("text", "sentence"), [
    (POSES + "a,1,2,3,4,5,x\n", "poses.csv:2: rx_deg is 'x', expected a number"),
    (POSES + "a,500,2,3,0,0,3.14159\n", "poses.csv:2: rx_deg is 3.14159: radians?"),
    (POSES + "a,0.5,0.2,0.3,0,0,180\n", "no pose lies 5 mm from the origin: metres?"),
    (POSES + "a,500,2,3,4,5,180\na,500,2,3,4,5,180\n", "poses.csv:3: id 'a' stands already in line 2"),
    (POSES + ",500,2,3,4,5,180\n", "poses.csv:2: id is empty"),
    (POSES.replace("rx_deg", "rx_rad") + "a,1,2,3,4,5,6\n", "column 'rx_deg' is missing; did you mean 'rx_rad'?"),
])  # fmt: skip
def test_mistakes_in_poses_are_named_with_their_line(text, sentence, folder, touchcal):
    (folder / "poses.csv").write_text(text)

    code, _, err = touchcal("compensate", "calibration.json", "poses.csv")

    assert code == 2
    assert sentence in err


def test_poses_in_what_looks_like_radians_are_read_where_the_user_says_so(folder, touchcal):
    (folder / "poses.csv").write_text(POSES + "a,500,2,3,0,0,3.14159\n")

    assert touchcal("compensate", "calibration.json", "poses.csv", "--trust-units")[0] == 0


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
