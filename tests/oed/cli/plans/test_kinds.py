"""touchcal plan --kinds: a plan file that says what is done at each row, and a table that identify takes."""

import json
import shutil
from contextlib import redirect_stdout
from functools import partial
from io import StringIO

import numpy as np
import pytest

from identify.model.files import InputError
from identify.model.io.description import read_cell
from identify.model.io.measurements import read_measurements
from identify.model.io.tables import read_plan
from oed.cli import main
from oed.cli.plans.kinds import minutes_of
from oed.planning import kinds

POINTS = """
points:
  anchor_a: {x_mm: 450, y_mm: -50, z_mm: 10, sigma_mm: 0.05}
  anchor_b: {x_mm: -50, y_mm: 350, z_mm: 10}
measure:
  distance: {minutes: 0.2, sigma_mm: 0.02, range_mm: [300, 900]}
"""


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A folder in which touches and distances were planned, and what the command said."""
    folder = tmp_path_factory.mktemp("kinds")
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as said:
        patch.setattr(kinds, "plan_kinds", partial(kinds.plan_kinds, count=200))
        assert run("init", folder) == 0
        with (folder / "cell.yaml").open("a") as file:
            file.write(POINTS)
        patch.chdir(folder)
        assert run("plan", "--kinds", "touch,distance", "--budget", "8min") == 0
    return folder, said.getvalue()


def run(*words):
    with pytest.raises(SystemExit) as stop:
        main([str(word) for word in words])
    return stop.value.code


@pytest.fixture
def folder(planned, tmp_path, monkeypatch):
    """A copy of that folder."""
    monkeypatch.chdir(shutil.copytree(planned[0], tmp_path / "mine"))
    return tmp_path / "mine"


def test_a_plan_of_two_kinds_says_for_each_row_what_is_done_and_run_takes_its_touches(planned):
    folder, out = planned

    told = json.loads((folder / "plan.json").read_text())
    lines = (folder / "plan.csv").read_text().splitlines()
    counts = told["measurements"]
    assert f"{counts['touch']} of kind touch, {counts['distance']} of kind distance" in out
    assert "distance alone, the same minutes" in out
    assert [line.split(",")[1] for line in lines[1:]].count("distance") == counts["distance"]
    assert "read the distance to anchor_" in lines[-1]
    assert lines[1].split(",")[2].startswith("search ")
    plan = read_plan(folder / "plan.csv", read_cell(folder / "cell.yaml"))
    assert len(plan) == counts["touch"]
    assert "measurements of kind distance" in (folder / "plan.html").read_text()


def test_the_table_of_readings_is_a_file_of_measurements_once_it_is_filled(folder, touchcal):
    lines = (folder / "plan-readings.csv").read_text().splitlines()
    assert lines[0].endswith("anchor,distance_mm")
    (folder / "distances.csv").write_text("\n".join([lines[0], *(f"{line}512.5" for line in lines[1:])]) + "\n")

    cell = read_cell(folder / "cell.yaml")
    (table,) = read_measurements(folder / "distances.csv", cell)

    assert len(table) == len(lines) - 1
    np.testing.assert_array_equal(table.sigma, 0.02)
    code, _, err = touchcal("identify", folder / "plan-readings.csv")
    assert code == 2
    assert "distance_mm" in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--kinds", "touch"), "write --budget 15min"),
        (("--kinds", "touch", "--budget", "soon"), "--budget is 'soon'"),
        (("--budget", "5min", "-n", "40"), "-n does not go with"),
        (("--kinds", "touch,ball", "--budget", "5"), "kind 'ball' is not known"),
    ],
)
def test_options_that_do_not_go_together_are_refused(folder, touchcal, options, words):
    (folder / "plan.csv").unlink()

    code, _, err = touchcal("plan", *options)

    assert code == 2
    assert words in err
    assert not (folder / "plan.csv").exists()


@pytest.mark.parametrize(("text", "minutes"), [("15min", 15), ("1h", 60), ("90s", 1.5), ("2.5", 2.5), (" 3 m", 3)])
def test_a_budget_is_read_in_minutes(text, minutes):
    assert minutes_of(text) == pytest.approx(minutes)


def test_a_budget_that_is_none_is_refused():
    with pytest.raises(InputError, match="15min for example"):
        minutes_of("15 parsec")
