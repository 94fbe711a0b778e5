"""Joint errors from the command line: asked for by name, chosen by the touches, told and written."""

import json

import numpy as np
import pytest
from measured import positions_at

from identify.estimation.selection import with_errors
from identify.model.io.calibration_file import read_calibration
from identify.model.io.description import library
from identify.model.io.tables import positions_text
from identify.model.joint_error_models import ERROR_MODELS


@pytest.fixture(scope="module")
def sheet(arc_welder):
    """Positions of a robot that bends, as text."""
    bending = with_errors(arc_welder, ("compliance",))
    theta, names, rng = bending.theta.copy(), bending.robot.parameters, np.random.default_rng(2)
    for name in ("j2.sag4", "j3.sag4", "j3.load", "base.load"):
        theta[names.index(name)] = np.radians(0.3)  # a metre
    q = rng.uniform(0.8 * bending.robot.lower, 0.8 * bending.robot.upper, (120, 6))
    return positions_text(positions_at(bending, theta, q, rng, 0.05), arc_welder.robot)


@pytest.fixture(autouse=True)
def folder(sheet, tmp_path, monkeypatch):
    (tmp_path / "cell.yaml").write_text(library("cells")["arc-welder"].read_text())
    (tmp_path / "positions.csv").write_text(sheet)
    monkeypatch.chdir(tmp_path)


def test_the_touches_choose_what_is_there_and_it_is_told_and_written(touchcal, tmp_path):
    code, out, _ = touchcal("identify", "positions.csv", "--errors", "auto")

    assert code == 0
    kept = next(line for line in out.splitlines() if line.strip().startswith("compliance"))
    assert kept.endswith("kept")
    assert float(kept.split()[2]) > 0.05  # [mm] that it buys
    again = read_calibration(tmp_path / "calibration.json")
    assert set(again.cell.robot.errors) == set(ERROR_MODELS) - {"thermal"}  # no temperature was recorded
    names = again.cell.robot.parameters
    sag = np.degrees(again.theta[[names.index(name) for name in ("j2.sag4", "j3.sag4")]])
    assert 0.1 < sag.mean() < 0.5  # [deg/m], 0.3 put in
    assert again.choice[0].name == "compliance"
    assert "deg/m" in (tmp_path / "calibration.json").read_text()


def test_json_tells_the_choice_and_the_findings(touchcal):
    code, out, _ = touchcal("identify", "positions.csv", "--errors", "auto", "--json")

    told = json.loads(out)
    assert code == 0
    assert set(told["errors"]) == set(ERROR_MODELS) - {"thermal"}
    assert told["choice"][0]["kept"]
    assert isinstance(told["findings"], list)


@pytest.mark.parametrize(("asked", "got"), [("none", []), ("gear, harmonics", ["gear", "harmonics"])])
def test_errors_are_taken_by_name(asked, got, touchcal):
    _, out, _ = touchcal("identify", "positions.csv", "--errors", asked, "--json")

    assert json.loads(out)["errors"] == got


def test_an_unknown_name_is_answered_with_the_nearest(touchcal, tmp_path):
    code, _, err = touchcal("identify", "positions.csv", "--errors", "compliances")

    assert code == 2
    assert "did you mean 'compliance'" in err
    assert not (tmp_path / "calibration.json").exists()


def test_a_calibration_of_positions_tells_errors_where_it_has_not_seen(touchcal, arc_welder, tmp_path):
    lines = (tmp_path / "positions.csv").read_text().splitlines()
    (tmp_path / "positions.csv").write_text("\n".join(lines[:91]) + "\n")
    (tmp_path / "unseen.csv").write_text("\n".join([lines[0], *lines[91:]]) + "\n")
    touchcal("identify", "positions.csv", "--errors", "auto")
    touchcal("identify", "positions.csv", "--errors", "none", "--keep", "-o", "geometry.json")

    bent, rigid = (
        json.loads(touchcal("verify", name, "unseen.csv", "--json")[1])["mean_mm"]
        for name in ("calibration.json", "geometry.json")
    )

    assert bent < 0.13 < rigid  # [mm], of which the tracker's scatter is 0.08
