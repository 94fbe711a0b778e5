"""`touchcal run` as a user meets it: whole plans over ports of other programs, and every reason not to begin."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from csv import DictReader
from pathlib import Path

import numpy as np
import pytest
from sessions import rebuilt
from virtual_support import make_plan, with_effects

from identify.model.cell import Cell
from identify.model.io.description import library
from identify.model.io.tables import plan_text, read_touches
from identify.model.touch import Plan
from probe.controllers import open_controller
from probe.runs.session import Session
from probe.virtual.server import VirtualCell, serve
from probe.virtual.truth import draw_truth

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def plan(arc_welder: Cell) -> Plan:
    """Touches on the highest face, all from one side."""
    plan = make_plan(arc_welder, 100, seed=5)
    high = plan.take(np.flatnonzero([face == "top-high" for face in plan.face]))
    apart = np.abs(high.q[:, None] - high.q).max(axis=2)
    return high.take(np.argsort(apart[np.argmin(np.sort(apart, axis=1)[:, 3])])[:4])


@pytest.fixture
def project(arc_welder: Cell, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "cell.yaml").write_text(library("cells")["arc-welder"].read_text())
    (tmp_path / "plan.csv").write_text(plan_text(plan, arc_welder.robot))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@contextmanager
def served_to(cell: Cell, plan: Plan, protocol: str = "line", **options: object) -> Iterator[VirtualCell]:
    truth = draw_truth(cell, np.random.default_rng(3), scale=0.1)
    truth = with_effects(truth, **options.pop("effects", {}))
    with serve(cell, truth, protocol=protocol, speed=np.inf, start=plan.approach[0], **options) as served:
        yield served


@pytest.mark.parametrize("by_cell_file", [True, False])
def test_a_plan_is_made_over_grbl_in_the_axis_units_that_it_has(
    arc_welder: Cell, plan: Plan, project: Path, touchcal: Run, by_cell_file: bool
) -> None:
    asked = ["--protocol", "grbl", "--axis-unit-deg", "0.1"]
    if by_cell_file:
        text = (project / "cell.yaml").read_text()
        line = "controller: {port: sim, protocol: grbl, axis_unit_deg: 0.1}"
        (project / "cell.yaml").write_text(text.replace("controller: {port: sim, protocol: line}", line))
        asked = []

    with served_to(arc_welder, plan, "grbl", axis_unit_deg=0.1) as served:
        code, out, err = touchcal("run", "plan.csv", "--port", served.url, "--json", *asked)

        assert code == 0, err
        assert json.loads(out)["hits"] == len(plan)
        touches = read_touches(project / "touches.csv", arc_welder)
        latched = np.stack([touch.latch for touch in served.robot.touches])
        assert all(np.degrees(np.abs(latched - q).max(axis=1).min()) < 1e-4 for q in touches.q)


def test_a_locked_grbl_is_unlocked_only_where_that_is_asked(
    arc_welder: Cell, plan: Plan, project: Path, touchcal: Run
) -> None:
    with served_to(arc_welder, plan, "grbl") as served:
        served.controller.alarm = 1  # type: ignore[attr-defined]
        ask = ["run", "plan.csv", "--port", served.url, "--protocol", "grbl"]
        locked, unlocked = touchcal(*ask), touchcal(*ask, "--unlock")

        assert locked[0] == 2
        assert "locked by an alarm" in locked[2]
        assert unlocked[0] == 0, unlocked[2]


def test_two_speeds_tell_how_late_the_signal_comes_and_leave_a_table_without_that(
    arc_welder: Cell, plan: Plan, project: Path, touchcal: Run
) -> None:
    late = {"relay_delay": 0.02, "sigma": 0.0}
    with served_to(arc_welder, plan, effects=late) as served:
        code, out, err = touchcal("run", "plan.csv", "--port", served.url, "--two-speeds", "--json")

        assert code == 0, err
        assert json.loads(out)["delay"]["seconds"] == pytest.approx(0.0205, abs=0.0005)  # and half a servo step
        true = np.stack([touch.q for touch in served.robot.touches])
    measured, corrected = (
        read_touches(project / name, arc_welder).q for name in ("touches.csv", "touches-corrected.csv")
    )
    off = [max(np.abs(true - row).max(axis=1).min() for row in q) for q in (measured, corrected)]
    assert off[1] < 0.1 * off[0]


def test_what_is_asked_for_on_the_command_line_is_done(
    arc_welder: Cell, plan: Plan, project: Path, touchcal: Run
) -> None:
    with served_to(arc_welder, plan) as served:
        ask = ["run", "plan.csv", "--port", served.url]
        code, _, err = touchcal(
            *ask,
            "--again-every",
            2,
            "--temperature",
            21.5,
            "--note",
            "first shift",
            "--override",
            0.5,
            "--search-speed",
            10,
            "--transcript",
            "said.txt",
        )

        assert code == 0, err
        rows = list(DictReader((project / "touches.csv").read_text().splitlines()))
        assert [row["id"] for row in rows if "~" in row["id"]] == [f"{plan.ids[0]}~2", f"{plan.ids[0]}~3"]
        assert {(row["temperature_c"], row["note"]) for row in rows} == {("21.5", "first shift")}
        assert "mm from its first time" in err
        assert "SEARCH" in (project / "said.txt").read_text()


def test_the_table_is_completed_from_the_journal_by_going_on(
    arc_welder: Cell, plan: Plan, project: Path, touchcal: Run
) -> None:
    with served_to(arc_welder, plan) as served:
        ask = ["run", "plan.csv", "--port", served.url]
        assert touchcal(*ask)[0] == 0
        before = (project / "touches.csv").read_bytes()
        (project / "touches.csv").unlink()

        code, out, _ = touchcal(*ask, "--resume")

    assert code == 0
    assert (project / "touches.csv").read_bytes() == before
    assert rebuilt(project / "touches.journal").encode() == before
    assert f"{len(plan)} of {len(plan)} touches" in out


# reasons not to begin


def refused(said: tuple[int, str, str], *words: str) -> None:
    """One sentence, and the exit code of bad input."""
    code, out, err = said
    assert code == 2, err
    assert out == ""
    complaints = err.splitlines()[next(i for i, s in enumerate(err.splitlines()) if s.startswith("touchcal: ")) :]
    assert len(complaints) == 1
    assert "Traceback" not in err
    for word in words:
        assert word in err


def test_a_plan_for_another_robot_is_refused(arc_welder: Cell, plan: Plan, project: Path, touchcal: Run) -> None:
    text = (project / "cell.yaml").read_text()
    (project / "cell.yaml").write_text(text.replace("robot: library:arc-welder", "robot: library:irb120"))

    with served_to(arc_welder, plan) as served:
        refused(touchcal("run", "plan.csv", "--port", served.url), "is the plan for another robot or cell?")

        assert served.robot.executed == []


def test_joints_beyond_the_limits_are_refused(arc_welder: Cell, plan: Plan, project: Path, touchcal: Run) -> None:
    lines = (project / "plan.csv").read_text().splitlines()
    row = lines[2].split(",")
    row[lines[0].split(",").index("q2_deg")] = "400"
    (project / "plan.csv").write_text("\n".join([*lines[:2], ",".join(row), *lines[3:]]) + "\n")

    with served_to(arc_welder, plan) as served:
        refused(touchcal("run", "plan.csv", "--port", served.url), "400", "expected")

        assert served.robot.executed == []


def test_a_search_faster_than_the_joints_is_refused(arc_welder: Cell, plan: Plan, project: Path, touchcal: Run) -> None:
    with served_to(arc_welder, plan) as served:
        code, _, err = touchcal("run", "plan.csv", "--port", served.url, "--search-speed", 5000)

        assert code == 2
        assert "search slower" in err
        assert served.robot.executed == []


def test_a_port_that_another_program_holds_is_refused(
    arc_welder: Cell, plan: Plan, project: Path, touchcal: Run
) -> None:
    with served_to(arc_welder, plan) as served:
        first = open_controller(served.url, "line", arc_welder.robot)
        refused(touchcal("run", "plan.csv", "--port", served.url), "taken by another program")
        first.close()

        assert served.robot.executed == []


def test_a_port_that_is_none_is_refused(project: Path, touchcal: Run) -> None:
    refused(touchcal("run", "plan.csv", "--port", "/dev/ttyNONE0"), "/dev/ttyNONE0", "does not exist")
    refused(touchcal("run", "plan.csv", "--port", "socket://127.0.0.1:9"), "nothing listens")
    refused(touchcal("run", "plan.csv", "--port", "carrier://pigeon"), "is no port")


def test_a_wrong_baud_rate_is_suspected(project: Path, noisy_port: str, touchcal: Run) -> None:
    refused(touchcal("run", "plan.csv", "--port", noisy_port, "--baud", 9600), "is 9600 its baud rate")


@pytest.mark.parametrize(("spoken", "asked"), [("grbl", "line"), ("line", "grbl"), ("line", "linuxcnc")])
def test_a_controller_of_another_protocol_is_named(
    arc_welder: Cell, plan: Plan, project: Path, touchcal: Run, spoken: str, asked: str
) -> None:
    with served_to(arc_welder, plan, spoken) as served:
        said = touchcal("run", "plan.csv", "--port", served.url, "--protocol", asked)
        refused(said, f"speaks {spoken}, not {asked}; say --protocol {spoken}")

        assert served.robot.executed == []


@pytest.mark.parametrize("protocol", ["line", "grbl"])
def test_an_unhomed_machine_is_refused(
    arc_welder: Cell, plan: Plan, project: Path, touchcal: Run, protocol: str
) -> None:
    with served_to(arc_welder, plan, protocol) as served:
        served.reboot(keeps_position=False)
        refused(
            touchcal("run", "plan.csv", "--port", served.url, "--protocol", protocol),
            "homed" if protocol == "line" else "home it",
        )

        assert served.robot.executed == []


@pytest.mark.parametrize("dry", [[], ["--dry-run"]])
def test_a_touch_closed_at_the_start_is_refused(
    arc_welder: Cell, plan: Plan, project: Path, touchcal: Run, dry: list[str]
) -> None:
    with served_to(arc_welder, plan) as served:
        served.robot.health.stuck = True
        refused(touchcal("run", "plan.csv", "--port", served.url, *dry), "input is closed before the first motion")

        assert served.robot.executed == []


def test_what_a_protocol_cannot_do_is_not_asked_of_it(project: Path, touchcal: Run) -> None:
    refused(touchcal("run", "plan.csv", "--home"), "protocol 'line' has no option 'home'")
    refused(touchcal("run", "plan.csv", "--protocol", "grbl", "--axis-unit-deg", 0), "--axis-unit-deg is 0")
    refused(touchcal("run", "plan.csv", "--protocol", "gbrl"), "grbl")


def test_a_second_program_on_the_same_session_is_refused(
    arc_welder: Cell, plan: Plan, project: Path, touchcal: Run
) -> None:
    with served_to(arc_welder, plan) as served, Session(project / "touches.csv", arc_welder, plan):
        refused(touchcal("run", "plan.csv", "--port", served.url), "another program works on this session")

        assert served.robot.executed == []
