"""`touchcal import`: touches from what a program logged."""

import json
from pathlib import Path

from maker_bench import execute
from maker_machine import Machine, scripted
from program_plan import FEW, say_counting

from identify.model.io.tables import read_plan, read_touches
from probe.virtual.truth import Truth


def log_of(maker, cell, four_planned, **faults) -> list[Path]:
    """What the files in a folder leave when they run."""
    files = {path.name: path.read_bytes().decode() for path in (four_planned / "program").iterdir()}
    plan = read_plan(four_planned / "plan.csv", cell)
    logs = execute(maker, Machine(scripted(cell, Truth(cell.theta), plan, **faults)), files)
    for name, text in logs.items():
        (four_planned / name).write_text(text, newline="")
    return [four_planned / name for name in logs]


def test_a_plan_becomes_a_program_and_its_log_touches(four_planned, touchcal, arc_welder):
    code, said, _ = touchcal("program", "plan.csv", "--maker", "abb", "--tool", "tTorch")
    assert code == 0
    assert "no real controller has run it yet" in said
    assert sorted(p.name for p in Path("program").iterdir()) == ["OPERATOR.md", "TC1.mod"]
    logs = log_of("abb", arc_welder, four_planned, missing={2})

    code, said, _ = touchcal("import", *logs, "--plan", "plan.csv", "--maker", "abb", "--temperature", "21.5", "--json")

    assert code == 0
    assert json.loads(said) == {"touches": FEW, "hit": FEW - 1, "miss": 1, "not_made": []}
    touches = read_touches(Path("touches.csv"), arc_welder)
    assert len(touches) == FEW - 1
    assert set(touches.temperature) == {21.5}


def test_measured_touches_are_not_overwritten_and_no_hit_is_exit_1(four_planned, touchcal, arc_welder):
    say_counting(four_planned, "{coupled: {}}")
    touchcal("program", "plan.csv", "--maker", "fanuc")
    logs = log_of("fanuc", arc_welder, four_planned, missing=range(1, FEW + 1))

    code, said, _ = touchcal("import", *logs, "--plan", "plan.csv", "--maker", "fanuc")
    assert code == 1
    assert said.count("miss, nothing met") == FEW
    code, _, complaint = touchcal("import", *logs, "--plan", "plan.csv", "--maker", "fanuc")
    assert code == 2
    assert "touches.csv: it is there already; write elsewhere with -o" in complaint
