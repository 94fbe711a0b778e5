"""A disk that is full or a folder that is read-only is said in one sentence, and costs nothing that was finished."""

import resource
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from virtual_support import make_plan

from identify.model.cell import Cell
from identify.model.io.description import library
from identify.model.io.tables import plan_text, read_touches
from identify.model.touch import Plan

MAIN = "from oed.cli import main; main()"
SMALL = 300  # [bytes] that a file may have: less than any file of a project


def touchcal(folder: Path, *arguments: str, room: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command where no file may grow beyond `room` bytes, as on a disk that is full."""

    def limit() -> None:
        if room is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    return subprocess.run(
        [sys.executable, "-c", MAIN, *arguments], cwd=folder, preexec_fn=limit, capture_output=True, text=True
    )


@pytest.fixture(scope="module")
def plan(arc_welder: Cell) -> Plan:
    """Touches on the highest face, all from one side."""
    plan = make_plan(arc_welder, 40, seed=5)
    high = plan.take(np.flatnonzero([face == "top-high" for face in plan.face]))
    apart = np.abs(high.q[:, None] - high.q).max(axis=2)
    return high.take(np.argsort(apart[np.argmin(np.sort(apart, axis=1)[:, 3])])[:4])


@pytest.fixture
def project(arc_welder: Cell, plan: Plan, tmp_path: Path) -> Path:
    (tmp_path / "cell.yaml").write_text(library("cells")["arc-welder"].read_text())
    (tmp_path / "plan.csv").write_text(plan_text(plan, arc_welder.robot))
    return tmp_path


COMMANDS = [["demo", "-o", "d"], ["init", "new"], ["campaign", "-o", "c"], ["run", "plan.csv"]]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda words: words[0])
def test_a_full_disk_is_one_sentence(command, project):
    done = touchcal(project, *command, room=SMALL)

    assert done.returncode == (1 if command[0] == "run" else 2), done.stderr  # a run has begun: its work failed
    assert "cannot be written" in done.stderr or "nothing more can be written" in done.stderr
    assert done.stderr.count("touchcal:") == 1
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("command", [["demo", "-o", "/proc/d"], ["init", "/proc/d"], ["campaign", "-o", "/proc/d"]])
def test_a_folder_that_cannot_be_written_is_one_sentence(command, project):
    done = touchcal(project, *command)

    assert done.returncode == 2, done.stderr
    assert "/proc/d" in done.stderr
    assert done.stderr.count("touchcal:") == 1


def test_touches_made_before_the_disk_was_full_are_kept_and_the_run_goes_on(project, arc_welder, plan):
    words = ["run", "plan.csv", "--port", "sim", "--time-scale", "1000"]

    full = touchcal(project, *words, room=4500)
    before = (project / "touches.csv").read_text().splitlines()
    again = touchcal(project, *words, "--resume")

    assert full.returncode == 1, full.stderr
    assert full.stderr.count("touchcal:") == 1, full.stderr
    assert again.returncode == 0, again.stderr
    assert (project / "touches.csv").read_text().splitlines()[: len(before)] == before
    assert sorted(read_touches(project / "touches.csv", arc_welder).ids) == sorted(plan.ids)
