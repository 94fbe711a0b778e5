"""The commands around a cell, end to end: start a folder, check it, make touches over a real port, report."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from virtual_support import make_plan

from identify.model.frames import euler, transform
from identify.model.io.description import library, read_cell
from identify.model.io.tables import plan_text, read_touches

COMMAND = [str(Path(sys.executable).parent / "touchcal")]


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A folder with the paper's cell and a short plan on its highest face."""
    (tmp_path / "cell.yaml").write_text(library("cells")["arc-welder"].read_text())
    cell = read_cell(tmp_path / "cell.yaml")
    plan = make_plan(cell, 100, seed=5)
    high = plan.take(np.flatnonzero([face == "top-high" for face in plan.face]))
    apart = np.abs(high.q[:, None] - high.q).max(axis=2)
    start = np.argmin(np.sort(apart, axis=1)[:, 2])  # the two nearest to it are on the same branch of the arm
    (tmp_path / "plan.csv").write_text(plan_text(high.take(np.argsort(apart[start])[:3]), cell.robot))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("robot", library("robots"))
def test_init_makes_a_folder_that_check_accepts(robot, tmp_path, touchcal):
    code, out, _ = touchcal("init", tmp_path / "mine", "--robot", robot)
    assert (code, "touchcal check" in out) == (0, True)

    code, out, _ = touchcal("check", "--cell", tmp_path / "mine" / "cell.yaml")
    assert code == 0
    assert f"robot {robot}" in out


def test_init_overwrites_nothing(tmp_path, touchcal):
    touchcal("init", tmp_path)
    (tmp_path / "cell.yaml").write_text("mine")

    code, _, err = touchcal("init", tmp_path)

    assert code == 2
    assert "is there already" in err
    assert (tmp_path / "cell.yaml").read_text() == "mine"


def test_init_refuses_an_unknown_robot_with_a_hint(tmp_path, touchcal):
    code, _, err = touchcal("init", tmp_path / "new", "--robot", "puma")

    assert code == 2
    assert "did you mean 'puma560'?" in err
    assert not (tmp_path / "new").exists()


def test_check_says_that_an_empty_pendant_tells_too_little(tmp_path, touchcal):
    touchcal("init", tmp_path)

    code, _, err = touchcal("check", "--cell", tmp_path / "cell.yaml", "--pendant", tmp_path / "pendant.csv")

    assert code == 2
    assert "0 poses tell too little" in err


def test_the_embedded_virtual_robot_makes_touches(project, touchcal):
    code, out, err = touchcal("run", "plan.csv", "--json")

    assert code == 0, err
    assert json.loads(out)["hits"] == 3
    touches = read_touches(project / "touches.csv", read_cell(project / "cell.yaml"))
    assert list(touches.face) == ["top-high"] * 3


def test_a_dry_run_touches_nothing(project, touchcal):
    code, out, err = touchcal("run", "plan.csv", "--dry-run")

    assert code == 0, err
    assert "3 approaches visited" in out
    assert not (project / "touches.csv").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run", "none.csv"], "none.csv: no such file"),
        (["run", "plan.csv", "--port", "/dev/ttyNONE0"], "/dev/ttyNONE0"),
        (["run", "plan.csv", "--protocol", "linuxcnc"], "port sim speaks line or grbl"),
        (["run", "plan.csv", "--override", "3"], "--override is 3"),
        (["virtual", "--fault", "flip"], "fault 'flip' is unknown"),
        (["virtual", "--truth", "library:none"], "none"),
        (["report", "none.json"], "none.json: no such file"),
    ],
)
def test_bad_arguments_get_one_sentence_and_leave_nothing(arguments, sentence, project, touchcal):
    before = sorted(p.name for p in project.iterdir())

    code, _, err = touchcal(*arguments)

    assert code == 2
    assert sentence in err
    assert sorted(p.name for p in project.iterdir()) == before


def test_touches_go_through_a_port_that_another_process_serves(project, touchcal):
    serve = [*COMMAND, "virtual", "--truth", "library:arc-welder", "--speed", "20"]
    with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True, cwd=project) as served:
        try:
            url = served.stdout.readline().strip()
            code, out, err = touchcal("run", "plan.csv", "--port", url, "--time-scale", "20", "--json")
        finally:
            served.send_signal(signal.SIGINT)

    assert code == 0, err
    assert json.loads(out)["hits"] == 3


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
def test_ctrl_c_stops_the_robot_and_leaves_a_session_to_resume(project, touchcal):
    with subprocess.Popen(
        [*COMMAND, "run", "plan.csv", "--time-scale", "1", "--override", "0.2"],
        stderr=subprocess.PIPE,
        text=True,
        cwd=project,
    ) as running:
        for line in running.stderr:
            if line.startswith("[1/3]"):
                break
        time.sleep(0.1)
        running.send_signal(signal.SIGINT)
        rest = running.stderr.read()

    assert running.returncode == 130
    assert "--resume" in rest
    code, out, err = touchcal("run", "plan.csv", "--resume", "--json")
    assert code == 0, err
    assert json.loads(out)["hits"] == 3


def test_a_calibration_is_reported_with_the_touches_beside_it(project, touchcal, arc_welder):
    from measured import poses_over_jig, table_2, touches_at

    from identify.model.io.tables import touches_text

    rng = np.random.default_rng(3)
    touches = touches_at(arc_welder, table_2(arc_welder), poses_over_jig(arc_welder, 60, rng), rng)
    (project / "touches.csv").write_text(touches_text(touches, arc_welder.robot))
    touchcal("identify", "touches.csv")

    code, _, err = touchcal("report", "calibration.json")

    assert code == 0, err
    page = (project / "report.html").read_text()
    assert '"id": "t60"' in page
    assert json.loads((project / "report.json").read_text())["inputs"].keys() == {"touches.csv"}


def read_off(folder, touchcal, counts):
    """A cell and poses read off a pendant that shows `counts` times the joints of the model."""
    assert touchcal("init", folder)[0] == 0
    cell, pendant = folder / "cell.yaml", folder / "pendant.csv"
    described = read_cell(cell)
    q = np.random.default_rng(5).uniform(-0.8, 0.8, (6, 6))
    p, R = described.kinematics.flange(q, described.theta)
    tool = transform(described.tool)
    rz, ry, rx = np.degrees(euler(R @ tool[:3, :3]).T)
    rows = np.column_stack([np.degrees(q) @ counts.T, p + R @ tool[:3, 3], rx, ry, rz]).round(3)
    with pendant.open("a") as file:
        file.writelines(f"p{i}," + ",".join(map(str, row)) + "\n" for i, row in enumerate(rows.tolist()))
    return cell, pendant


def test_check_writes_that_no_joint_is_counted_with_another_where_model_and_pendant_agree(tmp_path, touchcal):
    cell, pendant = read_off(tmp_path, touchcal, np.eye(6))
    assert not read_cell(cell).robot.counting.stated

    code, said, _ = touchcal("check", "--cell", cell, "--pendant", pendant, "--fix")

    assert code == 0
    assert "wrote joints: {coupled: {}} into" in said
    assert read_cell(cell).robot.counting.stated
    assert not read_cell(cell).robot.counting.differs


def test_check_writes_how_the_controller_counts_and_keeps_the_comments(tmp_path, touchcal):
    cell, pendant = read_off(
        tmp_path,
        touchcal,
        np.array([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, -1, 1, 0, 0, 0], *np.diag([0, 0, 0, 1, -1, 1])[3:]]),
    )  # joint 3 against the horizontal, as FANUC shows it
    before = cell.read_text()

    proposed = touchcal("check", "--cell", cell, "--pendant", pendant)
    written = touchcal("check", "--cell", cell, "--pendant", pendant, "--fix")

    line = "joints: {sign: {j5: -1}, coupled: {j3: j2}}"
    assert proposed[0] == 1
    assert f"  {line}\n" in proposed[1]
    assert written[0] == 0
    assert cell.read_text() == before + line + "\n"
    assert "pendant: agrees" in written[1]
