"""A plan of several kinds: one row a measurement, and a table that reads back once it is filled in."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from instruments import ANCHOR, measured

from identify.model.cell import Point
from identify.model.io.kinds_plan import PlanPart, kinds_plan_text, readings_text, whole_plan
from identify.model.io.measurements import read_measurements
from identify.model.touch import Plan


@pytest.fixture
def cell(arc_welder):
    return replace(arc_welder, points={"pin": Point(ANCHOR)})


@pytest.fixture
def parts(cell, q):
    """Two touches, the second by a posture on the way, and two distances."""

    def plan(names, faces, q, via):
        tip = cell.kinematics.tip(q, cell.theta)[0]
        return Plan(names, faces, tip, np.tile([0.0, 0.0, 1.0], (2, 1)), q, q + 0.01, via)

    via = np.stack([np.full((1, 6), np.nan), q[1:2] + 0.02])
    distances = replace(measured("distance", cell, q[2:4]), ids=("d1", "d2"))
    return (
        PlanPart("touch", plan(("t1", "t2"), ("top-low",) * 2, q[:2], via), None),
        PlanPart("distance", plan(("d1", "d2"), ("",) * 2, q[2:4], np.empty((2, 0, 6))), distances),
    )


def test_the_whole_plan_keeps_the_way_to_each_measurement(parts):
    plan = whole_plan(parts)

    assert plan.ids == ("t1", "t2", "d1", "d2")
    for i, (part, k) in enumerate((part, k) for part in parts for k in range(2)):
        np.testing.assert_array_equal(plan.way(i), part.plan.way(k))


def test_each_row_says_its_kind_and_what_is_done_with_what(parts, cell):
    rows = list(csv.DictReader(kinds_plan_text(parts, cell.robot).splitlines()))

    assert [row["kind"] for row in rows] == ["touch", "touch", "distance", "distance"]
    assert "top-low" in rows[0]["does"]
    assert "pin" in rows[2]["does"]
    assert [row["nz"] != "" for row in rows] == [True, True, False, False]


def test_readings_that_are_filled_in_are_read_with_the_planned_joints(parts, cell, tmp_path):
    table = parts[1].table
    rows = list(csv.DictReader(readings_text(parts, cell.robot).splitlines()))
    assert [row["distance_mm"] for row in rows] == ["", ""]
    for row, distance in zip(rows, table.distance, strict=True):
        row["distance_mm"] = repr(float(distance))
    path = tmp_path / "readings.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)

    (again,) = read_measurements(path, cell)

    assert (again.ids, again.anchor) == (table.ids, table.anchor)
    np.testing.assert_allclose(again.q, table.q, atol=1e-10)
    np.testing.assert_allclose(again.distance, table.distance)
