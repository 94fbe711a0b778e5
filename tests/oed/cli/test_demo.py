"""`touchcal demo`: the whole job on the virtual robot, killed in the middle, and gone on with."""

import re
import subprocess
import time
from csv import DictReader
from functools import partial

import numpy as np
import pytest
from readme import activated

from identify.estimation.verification import verify
from identify.model.io.calibration_file import read_calibration
from identify.model.io.description import library, read_cell
from identify.model.io.tables import read_touches
from identify.model.zone import zone_poses
from oed.campaigns import demonstration
from oed.planning import uncertain
from oed.planning.plan import plan
from probe.virtual.truth import read_truth, truths

PATIENCE = 300.0  # [s] on a busy machine
SMALL = "touchcal demo -n 40 -o demo"
STAGE = 2  # in which it is killed
FEW = 1500  # candidates of the plans that follow


def test_a_demo_that_was_killed_goes_on_and_loses_and_doubles_no_touch(tmp_path, touchcal, monkeypatch):
    folder = tmp_path / "demo"
    process = subprocess.Popen(SMALL.split(), cwd=tmp_path, env=activated(), stdout=subprocess.DEVNULL)
    table, end = folder / f"touches-{STAGE}.csv", time.monotonic() + PATIENCE
    while not (table.exists() and table.read_text().count("\n") > 3):
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.005)
    process.kill()
    process.wait()
    first = folder / f"touches-{STAGE - 1}.csv"
    before = {path: path.read_bytes() for path in (*folder.glob("plan-*.csv"), first)}
    before |= {table: table.read_bytes().rpartition(b"\n")[0]}

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(uncertain, "ROUGH", FEW)
    monkeypatch.setattr(demonstration, "plan_touches", partial(plan, count=FEW))
    code, out, err = touchcal(*SMALL.split()[1:])

    assert code in (0, 1), err  # so few touches make no robot accurate enough
    assert all(path.read_bytes().startswith(content) for path, content in before.items())
    tried = [row["id"] for path in folder.glob("touches-*.csv") for row in DictReader(path.read_text().splitlines())]
    assert sorted(tried, key=int) == [str(i + 1) for i in range(len(tried))]
    assert f"of {len(tried)} touches met the jig, in " in out
    assert len(tried) == 40


def test_what_it_says_is_what_its_files_and_the_hidden_truth_say(demo):
    cell = read_cell(demo.folder / "cell.yaml")
    found, truth = read_calibration(demo.folder / "calibration.json"), read_truth(truths()["arc-welder"], cell)

    q = zone_poses(cell, None, 400, rng=np.random.default_rng(77))
    identified = found.cell.kinematics.tip(q, found.theta)[0]  # with joint errors
    error = np.linalg.norm(identified - cell.kinematics.tip(q, truth.theta)[0], axis=1)

    verdict, told = re.search(r"^(PASS|FAIL): tip RMS (\S+) mm", demo.said, re.MULTILINE).groups()
    assert np.sqrt(np.mean(error**2)) == pytest.approx(float(told), rel=0.3)  # other poses
    assert (verdict == "PASS") == (float(told) <= 0.05)


def test_its_folder_holds_a_report_corrected_poses_and_touches_that_the_fit_has_not_seen(demo):
    folder = demo.folder
    found = read_calibration(folder / "calibration.json")
    unseen = read_touches(folder / "unseen.csv", found.cell)

    verified = verify(found, unseen)

    assert verified.identified.rms_mm < verified.nominal.rms_mm / 10
    wanted, corrected = (
        list(DictReader((folder / name).read_text().splitlines())) for name in ("poses.csv", "corrected.csv")
    )
    assert [row["id"] for row in wanted] == [row["id"] for row in corrected]
    assert all(a["x_mm"] != b["x_mm"] for a, b in zip(wanted, corrected, strict=True))
    assert (folder / "report.html").read_text().startswith("<!doctype html>")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [(["-n", "12"], "12 touches cannot identify"), (["-n", "40"], "demo.json is not that of this demo")],
)
def test_what_cannot_be_is_refused_and_changes_nothing(demo, words, sentence, touchcal):
    before = {path.name: path.stat().st_mtime_ns for path in demo.folder.iterdir()}

    code, _, err = touchcal("demo", "-o", demo.folder, *words)

    assert code == 2
    assert sentence in err
    assert before == {path.name: path.stat().st_mtime_ns for path in demo.folder.iterdir()}


def test_a_project_of_one_s_own_is_not_overwritten(tmp_path, touchcal):
    own = library("cells")["arc-welder"].read_text() + "# mine\n"
    (tmp_path / "cell.yaml").write_text(own)

    code, _, err = touchcal("demo", "-o", tmp_path)

    assert code == 2
    assert "choose another folder" in err
    assert (tmp_path / "cell.yaml").read_text() == own
