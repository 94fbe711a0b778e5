"""What tests of commands that use a calibration share."""

from functools import partial

import numpy as np
import pytest
from identified import JOB, Q, identified, poses_at
from measured import poses_over_jig, positions_at, table_2, touches_at
from program_plan import FEW, PLAN
from virtual_support import make_plan

from identify.model.files import sheet_text
from identify.model.io.calibration_file import write_calibration
from identify.model.io.description import library
from identify.model.io.entries import POSE_KEYS, POSE_UNIT
from identify.model.io.tables import plan_text, positions_text, touches_text
from oed.planning import plan as planning


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


@pytest.fixture
def few_candidates(monkeypatch):
    """Plans from fewer candidates than a user gets, where a test is not about the best plan."""
    monkeypatch.setattr(planning, "plan", partial(planning.plan, count=1500))


@pytest.fixture(scope="session")
def three_touches(arc_welder):
    """A short plan on the highest face of the jig, as text."""
    plan = make_plan(arc_welder, 100, seed=5)
    high = plan.take(np.flatnonzero([face == "top-high" for face in plan.face]))
    apart = np.abs(high.q[:, None] - high.q).max(axis=2)
    start = np.argmin(np.sort(apart, axis=1)[:, 2])  # the two nearest to it are on the same branch of the arm
    return plan_text(high.take(np.argsort(apart[start])[:3]), arc_welder.robot)


@pytest.fixture
def planned(three_touches, tmp_path, monkeypatch):
    """A folder with the paper's cell and that plan."""
    (tmp_path / "cell.yaml").write_text(library("cells")["arc-welder"].read_text())
    (tmp_path / "plan.csv").write_text(three_touches)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def four_planned(tmp_path, monkeypatch):
    """A cell with four planned touches, from which programs are written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cell.yaml").write_text(library("cells")["arc-welder"].read_text())
    (tmp_path / "plan.csv").write_text("".join(PLAN.read_text().splitlines(keepends=True)[: FEW + 1]))
    return tmp_path
