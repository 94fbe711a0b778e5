"""Placements and points that nobody measured are found where they are by a robot that is as drawn."""

from dataclasses import replace

import numpy as np
import pytest

from identify.estimation.placement_guess import further_start
from identify.model.cell import Point, Wire
from identify.model.files import InputError
from identify.model.frames import inverse, transform
from identify.model.measurement import rows
from identify.model.touch import Contacts, Positions

SECOND = np.array([800.0, -200.0, 30.0, 1.2, 0.1, -0.2])  # second -> base, as the cell's base is


@pytest.fixture
def cell(arc_welder):
    return replace(arc_welder, wire=Wire(0.0, "point"), placements={"second": None}, points={"hole": Point(None)})


def stood(cell, q, base):
    """Tips as a stand sees them."""
    return cell.kinematics.tip(q, cell.robot.theta(base, cell.tool))[0]


def test_a_placement_is_where_its_positions_put_it(cell, rng):
    q = rng.uniform(-0.5, 0.5, (8, 6))
    m = len(q)
    table = Positions(tuple(map(str, range(m))), q, stood(cell, q, SECOND), np.full(m, 0.1), ("second",) * m)

    found = further_start(replace(cell, points={}), rows(cell.wire, [table]), cell.theta)

    np.testing.assert_allclose(transform(found["placement.second"]), transform(SECOND), atol=1e-6)


def test_a_point_is_the_mean_of_the_tips_in_it(cell, rng):
    q = rng.uniform(-0.5, 0.5, (5, 6))
    table = Contacts(tuple(map(str, range(5))), q, ("hole",) * 5, np.full(5, 0.1))

    found = further_start(replace(cell, placements={}), rows(cell.wire, [table]), cell.theta)

    np.testing.assert_allclose(found["point.hole"], stood(cell, q, cell.base).mean(axis=0), atol=1e-9)


def test_a_placement_that_nothing_ties_to_the_jig_is_the_frame_of_the_base(cell, rng):
    q = rng.uniform(-0.5, 0.5, (5, 6))
    table = Contacts(tuple(map(str, range(5))), q, ("hole",) * 5, np.full(5, 0.1), ("second",) * 5)

    found = further_start(cell, rows(cell.wire, [table]), cell.theta)

    np.testing.assert_array_equal(found["placement.second"], np.zeros(6))
    base_T_tip = inverse(transform(cell.base)) @ np.append(stood(cell, q, cell.base).mean(axis=0), 1)
    np.testing.assert_allclose(found["point.hole"], base_T_tip[:3], atol=1e-9)


@pytest.mark.parametrize("left_out", ["placements", "points"])
def test_what_was_not_measured_is_named(cell, left_out, rng):
    q = rng.uniform(-0.5, 0.5, (5, 6))
    table = Positions(tuple(map(str, range(5))), q, stood(cell, q, cell.base), np.full(5, 0.1))
    cell = replace(cell, **{left_out: {}})

    with pytest.raises(InputError, match=r"was not measured; measure .*, or take it out of (placements|points):"):
        further_start(cell, rows(cell.wire, [table]), cell.theta)
