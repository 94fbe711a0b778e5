"""The commands around a cell, end to end: start a folder, check it, make touches over a real port, report."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from identify.model import base_placement
from identify.model.io.description import library, read_cell
from identify.model.io.tables import read_touches

COMMAND = [str(Path(sys.executable).parent / "touchcal")]


@pytest.mark.parametrize("robot", library("robots"))
def test_init_makes_a_folder_that_check_accepts(robot, tmp_path, touchcal, monkeypatch):
    monkeypatch.setattr(base_placement, "TRIES", 1)
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


def test_the_embedded_virtual_robot_makes_touches(planned, touchcal):
    code, out, err = touchcal("run", "plan.csv", "--json")

    assert code == 0, err
    assert json.loads(out)["hits"] == 3
    touches = read_touches(planned / "touches.csv", read_cell(planned / "cell.yaml"))
    assert list(touches.face) == ["top-high"] * 3


def test_a_dry_run_touches_nothing(planned, touchcal):
    code, out, err = touchcal("run", "plan.csv", "--dry-run")

    assert code == 0, err
    assert "3 approaches visited" in out
    assert not (planned / "touches.csv").exists()


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
def test_bad_arguments_get_one_sentence_and_leave_nothing(arguments, sentence, planned, touchcal):
    before = sorted(p.name for p in planned.iterdir())

    code, _, err = touchcal(*arguments)

    assert code == 2
    assert sentence in err
    assert sorted(p.name for p in planned.iterdir()) == before


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
def test_ctrl_c_stops_the_robot_and_leaves_a_session_to_resume(planned, touchcal):
    with subprocess.Popen(
        [*COMMAND, "run", "plan.csv", "--time-scale", "1", "--override", "0.2"],
        stderr=subprocess.PIPE,
        text=True,
        cwd=planned,
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
