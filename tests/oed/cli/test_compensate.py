"""`touchcal compensate` as a user meets it: what it says, what it writes, what it answers to bad input."""

import csv
import json

import numpy as np
import pytest
from identified import Q, poses_at
from measured import table_2

from identify.model.files import sheet_text
from identify.model.frames import inverse, pose, transform
from identify.model.io.entries import POSE_KEYS, POSE_UNIT

POSES = "id,x_mm,y_mm,z_mm,rz_deg,ry_deg,rx_deg\n"


def rows(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def test_compensate_writes_joints_and_commands_and_names_what_it_left(project, touchcal, arc_welder):
    code, out, _ = touchcal("compensate", "calibration.json", "poses.csv", "--near", "5,10,-15,20,50,15")

    assert code == 0
    assert "2 of 3 poses corrected" in out
    assert "c: out of reach" in out
    found = rows(project / "corrected.csv")
    assert [row["status"] for row in found] == ["corrected", "corrected", "left"]
    for row, wanted in zip(found[:2], rows(project / "poses.csv"), strict=False):
        q = np.radians([float(row[f"q{i}_deg"]) for i in range(1, 7)])
        true = poses_at(arc_welder, q[None], table_2(arc_welder))[0]
        told = np.array([float(row[k]) for k in POSE_KEYS]) * POSE_UNIT
        assert np.abs(true[:3] - [float(wanted[k]) for k in POSE_KEYS[:3]]).max() < 1e-3
        assert np.abs(transform(poses_at(arc_welder, q[None])[0]) - transform(told)).max() < 1e-5
    last = rows(project / "poses.csv")[2]
    assert all(float(found[2][k]) == pytest.approx(float(last[k]), abs=1e-8) for k in POSE_KEYS)
    assert found[2]["q1_deg"] == ""


def test_compensate_counts_from_the_base_or_a_user_frame_where_it_is_told_to(project, touchcal, arc_welder):
    base_T_user = np.array([500.0, -100, 200, 30, -10, 5]) * POSE_UNIT
    frame = transform(arc_welder.theta[:6]) @ transform(base_T_user)
    values = pose(inverse(frame) @ transform(poses_at(arc_welder, Q[:2]))) / POSE_UNIT
    columns = {"id": ["a", "b"]} | dict(zip(POSE_KEYS, values.T, strict=True))
    (project / "user.csv").write_text(sheet_text(columns))

    touchcal("compensate", "calibration.json", "poses.csv", "--near", "5,10,-15,20,50,15", "-o", "jig.csv")
    code, _, err = touchcal(
        "compensate",
        "calibration.json",
        "user.csv",
        "--near",
        "5,10,-15,20,50,15",
        "--frame",
        "500,-100,200,30,-10,5",
        "-o",
        "user_out.csv",
    )

    assert (code, err) == (0, "")
    for a, b in zip(rows(project / "jig.csv"), rows(project / "user_out.csv"), strict=False):
        assert float(a["q2_deg"]) == pytest.approx(float(b["q2_deg"]), abs=1e-6)


def test_compensate_tells_scripts_what_it_did(project, touchcal):
    told = json.loads(touchcal("compensate", "calibration.json", "poses.csv", "--json")[1])

    assert told.keys() == {"poses", "corrected", "left", "shift_mm", "max_residual_mm"}
    assert told["poses"] == 3
    assert told["max_residual_mm"] < 1e-3


def test_compensate_can_be_told_how_far_joints_may_move(project, touchcal):
    told = json.loads(touchcal("compensate", "calibration.json", "poses.csv", "--max-change-deg", "0.1", "--json")[1])

    assert told["corrected"] == 0
    assert told["shift_mm"] is None


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (POSES + "a,1,2,3,4,5,x\n", "poses.csv:2: rx_deg is 'x', expected a number"),
        (POSES + "a,500,2,3,0,0,3.14159\n", "poses.csv:2: rx_deg is 3.14159: radians?"),
        (POSES + "a,0.5,0.2,0.3,0,0,180\n", "no pose lies 5 mm from the origin: metres?"),
        (POSES + "a,500,2,3,4,5,180\na,500,2,3,4,5,180\n", "poses.csv:3: id 'a' stands already in line 2"),
        (POSES + ",500,2,3,4,5,180\n", "poses.csv:2: id is empty"),
        (POSES.replace("rx_deg", "rx_rad") + "a,1,2,3,4,5,6\n", "column 'rx_deg' is missing; if 'rx_rad' is meant"),
    ],
)
def test_mistakes_in_poses_are_named_with_their_line(text, sentence, project, touchcal):
    (project / "poses.csv").write_text(text)

    code, _, err = touchcal("compensate", "calibration.json", "poses.csv")

    assert code == 2
    assert sentence in err


def test_poses_in_what_looks_like_radians_are_read_where_the_user_says_so(project, touchcal):
    (project / "poses.csv").write_text(POSES + "a,500,2,3,0,0,3.14159\n")

    assert touchcal("compensate", "calibration.json", "poses.csv", "--trust-units")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["compensate", "calibration.json", "none.csv"], "none.csv: no such file"),
        (["compensate", "none.json", "poses.csv"], "none.json: no such file"),
        (["compensate", "poses.csv", "poses.csv"], "not a calibration"),
        (["compensate", "calibration.json", "calibration.json"], "this is JSON, expected a table"),
        (["compensate", "calibration.json", "poses.csv", "--frame", "table"], "other than jig or base, is 'table'"),
        (["compensate", "calibration.json", "poses.csv", "--frame", "1,2,3"], "expected 6 numbers parted by commas"),
        (["compensate", "calibration.json", "poses.csv", "--near", "1,2"], "--near is '1,2', expected 6 numbers"),
        (["compensate", "calibration.json", "poses.csv", "-o", "no/such/project.csv"], "cannot be written"),
    ],
)
def test_bad_input_gets_one_sentence_and_exit_code_2(arguments, sentence, project, touchcal):
    before = sorted(project.rglob("*"))

    code, out, err = touchcal(*arguments)

    assert (code, out) == (2, "")
    assert sentence in err
    assert "Traceback" not in err
    assert sorted(project.rglob("*")) == before
