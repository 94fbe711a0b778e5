"""Further placements, tools and points: rows use them in place of base and tool, and differences confirm the slopes."""

from dataclasses import replace

import numpy as np
import pytest
from oracle import forward

from identify.model.cell import Point, Spacing
from identify.model.measurement import rows, spacing_rows
from identify.model.touch import Contacts, Distances, Positions
from identify.uncertainty.unknowns import Unknowns

SECOND = np.array([-200.0, 500.0, 100.0, 0.4, -0.1, 0.2])
BALL = np.array([20.0, -30.0, 300.0, 0.1, 0.2, 0.3])


@pytest.fixture
def cell(arc_welder):
    points = {"pin": Point(np.array([100.0, 50.0, 0.0]), 0.02), "hole": Point(None), "exact": Point(np.zeros(3))}
    spacings = (Spacing("pin", "hole", 50.0),)
    return replace(arc_welder, placements={"second": SECOND}, tools={"ball": BALL}, points=points, spacings=spacings)


@pytest.fixture
def mixed(cell, rng):
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (4, 6))
    ids, sigma = ("a", "b", "c", "d"), np.full(4, 0.1)
    positions = Positions(ids, q, np.zeros((4, 3)), sigma, ("", "second", "", "second"), ("", "", "ball", "ball"))
    distances = Distances(ids, q, ("pin", "hole", "exact", "pin"), np.full(4, 300.0), sigma, ("second",) * 4)
    contacts = Contacts(ids, q, ("hole",) * 4, sigma, tool=("ball",) * 4)
    spacing = spacing_rows([("pin", "hole", 50.0, 0.02)], cell.places, 6)
    return [rows(cell.wire, [positions, distances, contacts], places=cell.places), spacing], q


def test_the_names_of_unknowns_say_what_they_are(cell):
    names = Unknowns.of(cell).names

    assert names[-18:] == (
        *(f"placement.second.{axis}" for axis in ("x", "y", "z", "rz", "ry", "rx")),
        *(f"tool.ball.{axis}" for axis in ("x", "y", "z", "rz", "ry", "rx")),
        "point.pin.x",
        "point.pin.y",
        "point.pin.z",
        "point.hole.x",
        "point.hole.y",
        "point.hole.z",
    )


def test_what_is_to_be_fitted_has_no_prior_and_what_is_exact_is_no_unknown(cell):
    unknowns = Unknowns.of(replace(cell, placements={"second": None}))

    precision = dict(zip(unknowns.names, unknowns.precision, strict=True))
    assert precision["placement.second.rz"] == precision["point.hole.y"] == 0
    assert precision["tool.ball.x"] == precision["point.pin.x"] == 1
    assert not any("exact" in name for name in unknowns.names)


def test_slopes_by_every_unknown_are_those_of_differences(cell, mixed, rng):
    unknowns = Unknowns.of(cell)
    x = 0.1 * rng.standard_normal(len(unknowns))

    for table in mixed[0]:
        J = unknowns.linearize(x, table)[1]
        for k in range(len(unknowns)):
            step = 1e-5 * np.eye(len(unknowns))[k]
            up, down = (unknowns.linearize(x + sign * step, table)[0] for sign in (1, -1))
            np.testing.assert_allclose((up - down) / 2e-5, J[:, k], rtol=1e-4, atol=2e-4)


def test_a_row_of_a_further_stand_and_tool_sees_the_tip_from_there(cell, mixed):
    tables, q = mixed

    r = Unknowns.of(cell).linearize(np.zeros(len(Unknowns.of(cell))), tables[0])[0]

    theta = cell.theta.copy()
    theta[:6], theta[-6:] = SECOND, BALL
    np.testing.assert_allclose(r[9:12], forward(cell.robot, q[3], theta)[:3, 3], atol=1e-6)
    np.testing.assert_allclose(r[:3], forward(cell.robot, q[0], cell.theta)[:3, 3], atol=1e-6)


def test_a_cell_without_them_has_the_unknowns_that_it_had(arc_welder):
    assert Unknowns.of(arc_welder).named == ()
