"""What tests of commands that use a calibration share."""

import pytest
from identified import JOB, Q, identified, poses_at
from measured import table_2

from identify.model.files import sheet_text
from identify.model.io.calibration_file import write_calibration
from identify.model.io.entries import POSE_KEYS, POSE_UNIT


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
