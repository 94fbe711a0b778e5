"""touchcal init --measure: a cell for each device, from which a plan, readings and a calibration follow."""

import json
from functools import partial

import numpy as np
import pytest
from measuring import filled

from identify.model.io.calibration_file import read_calibration
from identify.model.io.description import read_cell
from identify.model.zone import zone_poses
from oed.planning import kinds
from probe.virtual.readings import draw_named


@pytest.mark.parametrize(
    ("measure", "kind", "most"),
    [("tracker", "position", 0.1), ("ballbar", "distance", 0.3), ("sockets", "contact", 1.5)],
)
def test_a_cell_for_a_device_leads_to_an_identified_robot(tmp_path, monkeypatch, touchcal, measure, kind, most):
    monkeypatch.setattr(kinds, "plan_kinds", partial(kinds.plan_kinds, count=150))
    code, out, _ = touchcal("init", tmp_path, "--robot", "irb120", "--measure", measure)
    monkeypatch.chdir(tmp_path)
    cell, rng = read_cell(tmp_path / "cell.yaml"), np.random.default_rng(3)
    assert code == 0
    assert f"touchcal plan --kinds {kind}" in out
    assert cell.jig is None

    assert touchcal("plan", "--kinds", kind, "--budget", "30min", "--json")[0] == 0
    further = draw_named(cell, rng)
    theta = cell.theta + 0.3 * cell.spread * rng.standard_normal(len(cell.theta))
    filled(tmp_path / "plan-readings.csv", cell, theta, rng, further, tmp_path / "measured.csv")
    code, out, err = touchcal("identify", "measured.csv", "--errors", "none")

    assert code == 0, err
    assert f"of kind {kind}" in out
    assert ("point." in out) == (measure != "tracker")
    found = read_calibration(tmp_path / "calibration.json")
    zone = zone_poses(cell, poses=100)
    off = np.linalg.norm(cell.kinematics.tip(zone, found.theta)[0] - cell.kinematics.tip(zone, theta)[0], axis=1)
    before = np.linalg.norm(cell.kinematics.tip(zone, cell.theta)[0] - cell.kinematics.tip(zone, theta)[0], axis=1)
    assert np.sqrt((off**2).mean()) < most  # [mm]
    assert np.sqrt((off**2).mean()) < 0.2 * np.sqrt((before**2).mean())
    assert bool(found.shared) == (measure != "tracker")
    if measure == "sockets":
        shared = json.loads(touchcal("identify", "measured.csv", "--errors", "none", "--json")[1])["shared"]
        assert shared.keys() == {value.name for value in found.shared}
        assert all(len(pair) == 2 for pair in shared.values())
    code, _, _ = touchcal("report", "calibration.json")
    assert code == 0
    if measure != "tracker":
        assert found.shared[0].name in (tmp_path / "report.html").read_text()
