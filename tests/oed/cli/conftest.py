"""What tests of commands that use a calibration share."""

import numpy as np
import pytest
from identified import JOB, Q, identified, poses_at
from measured import poses_over_jig, positions_at, table_2, touches_at

from identify.model.files import sheet_text
from identify.model.io.calibration_file import write_calibration
from identify.model.io.description import library
from identify.model.io.entries import POSE_KEYS, POSE_UNIT
from identify.model.io.tables import positions_text, touches_text


@pytest.fixture
def project(arc_welder, tmp_path, monkeypatch):
    """A calibration, poses (the last one out of reach) and a job."""
    write_calibration(tmp_path / "calibration.json", identified(arc_welder, table_2(arc_welder)))
    values = poses_at(arc_welder, Q) / POSE_UNIT
    values[2, 0] += 5000
    columns = {"id": ["a", "b", "c"]} | dict(zip(POSE_KEYS, values.T, strict=True))
    (tmp_path / "poses.csv").write_text(sheet_text(columns))
    (tmp_path / "SEAM.JBI").write_text(JOB)
    monkeypatch.chdir(tmp_path)
    return tmp_path


SIGMA = 0.05  # [mm]


@pytest.fixture(scope="module")
def sheets(arc_welder):
    """Touches for a fit, and positions that it does not see, as text."""
    rng = np.random.default_rng(4)
    q, truth = poses_over_jig(arc_welder, 160, rng), table_2(arc_welder)
    touches = touches_at(arc_welder, truth, q[:100], rng, SIGMA)
    return {
        "touches.csv": touches_text(touches, arc_welder.robot),
        "unseen.csv": positions_text(positions_at(arc_welder, truth, q[100:], rng, SIGMA), arc_welder.robot),
        "cell.yaml": library("cells")["arc-welder"].read_text(),
    }


@pytest.fixture
def folder(sheets, tmp_path, monkeypatch):
    for name, text in sheets.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path
