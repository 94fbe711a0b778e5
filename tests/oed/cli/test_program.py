"""`touchcal program` and `touchcal import`: from a plan to files and back."""

import json
from pathlib import Path

import numpy as np
import pytest
from maker_bench import execute
from maker_machine import Machine, scripted

from identify.model.io.description import library, read_cell
from identify.model.io.tables import plan_text, read_plan, read_touches
from probe.virtual.truth import Truth

PLAN = Path(__file__).parents[2] / "probe" / "programs" / "plan.csv"
FEW = 4


@pytest.fixture
def folder(tmp_path, monkeypatch, arc_welder):
    """A cell with four planned touches."""
    monkeypatch.chdir(tmp_path)
    Path("cell.yaml").write_text(library("cells")["arc-welder"].read_text())
    Path("plan.csv").write_text("".join(PLAN.read_text().splitlines(keepends=True)[: FEW + 1]))
    return tmp_path


def log_of(maker, cell, folder, **faults) -> list[Path]:
    """What the files in a folder leave when they run."""
    files = {path.name: path.read_bytes().decode() for path in (folder / "program").iterdir()}
    plan = read_plan(folder / "plan.csv", cell)
    logs = execute(maker, Machine(scripted(cell, Truth(cell.theta), plan, **faults)), files)
    for name, text in logs.items():
        (folder / name).write_text(text, newline="")
    return [folder / name for name in logs]


def test_a_plan_becomes_a_program_and_its_log_touches(folder, touchcal, arc_welder):
    code, said, _ = touchcal("program", "plan.csv", "--maker", "abb", "--tool", "tTorch")
    assert code == 0
    assert "no real controller has run it yet" in said
    assert sorted(p.name for p in Path("program").iterdir()) == ["OPERATOR.md", "TC1.mod"]
    logs = log_of("abb", arc_welder, folder, missing={2})

    code, said, _ = touchcal("import", *logs, "--plan", "plan.csv", "--maker", "abb", "--temperature", "21.5", "--json")

    assert code == 0
    assert json.loads(said) == {"touches": FEW, "hit": FEW - 1, "miss": 1, "not_made": []}
    touches = read_touches(Path("touches.csv"), arc_welder)
    assert len(touches) == FEW - 1
    assert set(touches.temperature) == {21.5}


@pytest.mark.parametrize("coupled", ["{j3: j2}", "{}"])
def test_nothing_is_written_or_read_for_a_fanuc_until_the_cell_says_how_it_counts(
    coupled, folder, touchcal, arc_welder
):
    (folder / "posreg1.va").write_text("")
    for arguments in (("program", "plan.csv"), ("import", "posreg1.va", "--plan", "plan.csv")):
        code, _, complaint = touchcal(*arguments, "--maker", "fanuc")
        assert code == 2
        assert "cell.yaml does not say how the controller counts j3" in complaint
        assert "touchcal check --pendant pendant.csv --fix writes it; or write joints: {coupled: {j3: j2}}" in complaint
    assert not Path("program").exists()
    assert touchcal("program", "plan.csv", "--maker", "abb", "-o", "other")[0] == 0

    say_counting(folder, f"{{coupled: {coupled}}}")
    counted = read_cell(folder / "cell.yaml").robot
    (folder / "plan.csv").write_text(plan_text(read_plan(PLAN, arc_welder).take(np.arange(FEW)), counted))
    assert touchcal("program", "plan.csv", "--maker", "fanuc")[0] == 0


def say_counting(folder, joints):
    """The cell file says how the controller counts."""
    (folder / "cell.yaml").write_text((folder / "cell.yaml").read_text() + f"joints: {joints}\n")


def test_measured_touches_are_not_overwritten_and_no_hit_is_exit_1(folder, touchcal, arc_welder):
    say_counting(folder, "{coupled: {}}")
    touchcal("program", "plan.csv", "--maker", "fanuc")
    logs = log_of("fanuc", arc_welder, folder, missing=range(1, FEW + 1))

    code, said, _ = touchcal("import", *logs, "--plan", "plan.csv", "--maker", "fanuc")
    assert code == 1
    assert said.count("miss, nothing met") == FEW
    code, _, complaint = touchcal("import", *logs, "--plan", "plan.csv", "--maker", "fanuc")
    assert code == 2
    assert "touches.csv: it is there already; write elsewhere with -o" in complaint


def test_the_files_of_another_program_are_not_mixed_up(folder, touchcal):
    touchcal("program", "plan.csv", "--maker", "kuka")

    code, _, complaint = touchcal("program", "plan.csv", "--maker", "abb")

    assert code == 2
    assert "it holds TC1.dat, TC1.src of another program; choose an empty folder with -o" in complaint


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("program", "plan.csv", "--maker", "kukka"), "did you mean 'kuka'?"),
        (("program", "none.csv", "--maker", "kuka"), "none.csv: no such file"),
        (("program", "plan.csv", "--maker", "yaskawa"), "pulses_per_deg"),
        (("program", "plan.csv", "--maker", "ur", "-o", "cell.yaml"), "cell.yaml: it is no folder"),
        (("import", "--plan", "plan.csv", "--maker", "abb"), "no log is named"),
        (("import", "none.txt", "--plan", "plan.csv", "--maker", "abb"), "none.txt: no such file"),
        (("import", "--plan", "plan.csv", "--maker", "abb", "--listen", "30100"), "--listen is for --maker ur"),
        (("import", "--plan", "plan.csv", "--maker", "ur", "--listen", "here"), "expected HOST:PORT or PORT"),
    ],
)
def test_bad_input_is_answered_in_one_sentence_and_with_exit_2(arguments, words, folder, touchcal):
    code, _, complaint = touchcal(*arguments)

    assert code == 2
    assert words in complaint
    assert complaint.count("\n") == 1
    assert not Path("touches.csv").exists()
    assert not Path("program").exists()


def test_the_test_plan_is_what_it_says(arc_welder):
    plan = read_plan(PLAN, arc_welder)

    assert plan_text(plan, arc_welder.robot) == PLAN.read_text()
