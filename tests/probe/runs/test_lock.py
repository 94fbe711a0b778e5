"""One program at a time."""

import subprocess
import sys
from pathlib import Path

import pytest
from sessions import small_plan

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.touch import Plan
from probe.runs.session import Session

pytestmark = pytest.mark.usefixtures("unsynced")


@pytest.fixture(scope="module")
def plan() -> Plan:
    return small_plan()


def test_a_second_program_on_the_same_session_is_refused_until_the_first_is_dead(
    tmp_path: Path, arc_welder: Cell, plan: Plan
) -> None:
    path = tmp_path / "touches.csv"
    held = f"from probe.runs.lock import Lock; from pathlib import Path; Lock(Path({str(path.with_suffix('.lock'))!r}))"
    command = [sys.executable, "-c", f"{held}; print('held', flush=True); import time; time.sleep(60)"]

    with subprocess.Popen(command, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(InputError, match="another program works on this session"):
            Session(path, arc_welder, plan)
        other.kill()
        other.wait()

    Session(path, arc_welder, plan).close()


def test_a_folder_that_is_not_there_gets_one_sentence(tmp_path: Path, arc_welder: Cell, plan: Plan) -> None:
    with pytest.raises(InputError, match="choose another folder"):
        Session(tmp_path / "none" / "touches.csv", arc_welder, plan)
