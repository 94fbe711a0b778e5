"""`touchcal program` and `touchcal import`: from a plan to files and back."""

from pathlib import Path

import numpy as np
import pytest
from program_plan import FEW, PLAN, say_counting

from identify.model.io.description import read_cell
from identify.model.io.tables import plan_text, read_plan


@pytest.mark.parametrize("coupled", ["{j3: j2}", "{}"])
def test_nothing_is_written_or_read_for_a_fanuc_until_the_cell_says_how_it_counts(
    coupled, four_planned, touchcal, arc_welder
):
    (four_planned / "posreg1.va").write_text("")
    for arguments in (("program", "plan.csv"), ("import", "posreg1.va", "--plan", "plan.csv")):
        code, _, complaint = touchcal(*arguments, "--maker", "fanuc")
        assert code == 2
        assert "cell.yaml does not say how the controller counts j3" in complaint
        assert "touchcal check --pendant pendant.csv --fix writes it; or write joints: {coupled: {j3: j2}}" in complaint
    assert not Path("program").exists()
    assert touchcal("program", "plan.csv", "--maker", "abb", "-o", "other")[0] == 0

    say_counting(four_planned, f"{{coupled: {coupled}}}")
    counted = read_cell(four_planned / "cell.yaml").robot
    (four_planned / "plan.csv").write_text(plan_text(read_plan(PLAN, arc_welder).take(np.arange(FEW)), counted))
    assert touchcal("program", "plan.csv", "--maker", "fanuc")[0] == 0


def test_the_files_of_another_program_are_not_mixed_up(four_planned, touchcal):
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
def test_bad_input_is_answered_in_one_sentence_and_with_exit_2(arguments, words, four_planned, touchcal):
    code, _, complaint = touchcal(*arguments)

    assert code == 2
    assert words in complaint
    assert complaint.count("\n") == 1
    assert not Path("touches.csv").exists()
    assert not Path("program").exists()


def test_the_test_plan_is_what_it_says(arc_welder):
    plan = read_plan(PLAN, arc_welder)

    assert plan_text(plan, arc_welder.robot) == PLAN.read_text()
