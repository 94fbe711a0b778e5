"""`touchcal locate`: the pose in the base frame, and the same pose in the jig's."""

import json

import numpy as np
import pytest
from identified import identified
from measured import table_2
from scipy.spatial.transform import Rotation
from workpieces import SIGMA, SPREAD, hidden, touched, touches_of

from identify.model.frames import transform
from identify.model.io.calibration_file import write_calibration
from identify.model.io.tables import touches_text

THREE_TWO_ONE = ["top"] * 3 + ["front"] * 2 + ["right"]


def frame(entry):
    """A transform from what the file holds."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler(
        "ZYX", [entry[f"{key}_deg"] for key in ("rz", "ry", "rx")], degrees=True
    ).as_matrix()
    T[:3, 3] = [entry[f"{key}_mm"] for key in "xyz"]
    return T


@pytest.fixture
def folder(arc_welder, box, rng, tmp_path, monkeypatch):
    """Touches of a box that hides somewhere, by a robot that is known exactly."""
    monkeypatch.chdir(tmp_path)
    calibration = identified(arc_welder, table_2(arc_welder))
    write_calibration(tmp_path / "calibration.json", calibration)
    truth = hidden(calibration, rng)
    q = touched(calibration, box, truth, THREE_TWO_ONE, SPREAD, rng)
    (tmp_path / "box.csv").write_text(touches_text(touches_of(box, THREE_TWO_ONE, q, SIGMA), arc_welder.robot))
    return tmp_path, truth, calibration


def test_the_file_holds_the_pose_in_both_frames(folder, touchcal):
    path, truth, calibration = folder

    code, out, err = touchcal("locate", "calibration.json", "box.csv", "--workpiece", "library:cube")

    assert code == 0, err
    assert "from 6 touches" in out
    written = json.loads((path / "workpiece.json").read_text())
    base_T_workpiece = frame(written["base_T_workpiece"])
    np.testing.assert_allclose(base_T_workpiece[:3, 3], truth[:3, 3], atol=1.0)  # [mm], six touches of 0.05 mm
    np.testing.assert_allclose(
        frame(written["jig_T_workpiece"]), transform(calibration.theta[:6]) @ base_T_workpiece, atol=1e-6
    )
    assert written["degrees_of_freedom"] == 0


def test_nothing_to_locate_by_is_one_sentence(folder, touchcal):
    code, out, err = touchcal("locate", "calibration.json", "--workpiece", "library:cube")

    assert (code, out) == (2, "")
    assert "nothing to locate the workpiece by" in err
    assert not (folder[0] / "workpiece.json").exists()
