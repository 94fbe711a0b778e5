"""`touchcal demo`: the whole job on the virtual robot, killed in the middle, and gone on with."""

import json
import signal
import subprocess
import sys
import time
from csv import DictReader

import numpy as np
import pytest

from identify.model.calibration import read_calibration
from identify.model.description import library, read_cell
from identify.model.tables import read_touches
from identify.model.zone import zone_poses
from identify.verification import verify
from oed.cli import main
from probe.virtual.truth import read_truth, truths

FEW = 45  # touches: enough to identify the robot though some miss, too few to pass
COMMAND = [sys.executable, "-c", "from oed.cli import main; main()", "demo", "-o", "d", "-n", str(FEW), "--json"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The folder of a demo that was killed among the touches of its second stage, what stood there, and the end."""
    folder = tmp_path_factory.mktemp("demo")
    process = subprocess.Popen(COMMAND, cwd=folder, stdout=subprocess.DEVNULL)
    table, waited = folder / "d" / "touches-2.csv", time.monotonic() + 300
    while not (table.exists() and table.read_text().count("\n") > 3) and time.monotonic() < waited:
        assert process.poll() is None
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = {path.name: path.read_bytes() for path in (folder / "d").glob("plan-*.csv")}
    rows = table.read_text().splitlines()
    done = subprocess.run(COMMAND, cwd=folder, capture_output=True, text=True)
    return folder / "d", before, rows, done


def test_a_demo_that_was_killed_goes_on_and_loses_and_doubles_no_touch(made):
    folder, before, rows, done = made

    assert done.stderr == ""
    assert all((folder / name).read_bytes() == content for name, content in before.items())
    assert (folder / "touches-2.csv").read_text().splitlines()[: len(rows) - 1] == rows[:-1]
    tried = [row["id"] for path in folder.glob("touches-*.csv") for row in DictReader(path.read_text().splitlines())]
    assert sorted(tried, key=int) == [str(i + 1) for i in range(len(tried))]
    assert len(tried) == json.loads(done.stdout)["touches"]


def test_what_it_says_is_what_its_files_and_the_hidden_truth_say(made):
    folder, _, _, done = made
    told = json.loads(done.stdout)
    cell = read_cell(folder / "cell.yaml")
    found, truth = read_calibration(folder / "calibration.json"), read_truth(truths()["arc-welder"], cell)

    q = zone_poses(cell, None, 400, rng=np.random.default_rng(77))
    error = np.linalg.norm(cell.kinematics.tip(q, found.theta)[0] - cell.kinematics.tip(q, truth.theta)[0], axis=1)

    assert FEW - 9 <= told["touches"] <= FEW  # those that no clear way leads to are given up
    assert np.sqrt(np.mean(error**2)) == pytest.approx(told["zone_rms_mm"], rel=0.3)  # other poses
    assert told["passed"] == (told["zone_rms_mm"] <= 0.05)
    assert done.returncode == (0 if told["passed"] else 1)


def test_its_folder_holds_a_report_corrected_poses_and_touches_that_the_fit_has_not_seen(made):
    folder = made[0]
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
def test_what_cannot_be_is_refused_and_changes_nothing(made, words, sentence, capsys):
    folder = made[0]
    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir() if path.suffix in (".csv", ".yaml")}

    with pytest.raises(SystemExit) as stop:
        main(["demo", "-o", str(folder), *words])

    assert stop.value.code == 2
    assert sentence in capsys.readouterr().err
    assert before == {path.name: path.stat().st_mtime_ns for path in folder.iterdir() if path.name in before}


def test_a_project_of_one_s_own_is_not_overwritten(tmp_path, capsys):
    own = library("cells")["arc-welder"].read_text() + "# mine\n"
    (tmp_path / "cell.yaml").write_text(own)

    with pytest.raises(SystemExit) as stop:
        main(["demo", "-o", str(tmp_path)])

    assert stop.value.code == 2
    assert "choose another folder" in capsys.readouterr().err
    assert (tmp_path / "cell.yaml").read_text() == own
