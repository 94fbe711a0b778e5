"""The closed form finds base and tool of a robot as drawn wherever they are, from exact measurements."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from identify.estimation.initial_guess import starting_point
from identify.model.cell import Wire
from identify.model.files import InputError
from identify.model.frames import transform
from identify.model.measurement import rows
from identify.model.touch import HIT, Positions, Touches

BASE = np.array([-300.0, 900.0, 50.0, 2.0, -0.7, 0.4])
TOOL = np.array([40.0, -25.0, 300.0, 0.0, 0.0, 0.0])


@pytest.fixture
def pointed(arc_welder):
    """Base and tool of the hidden robot are far from those of the cell."""
    return replace(arc_welder, wire=Wire(0.0, "point"))


def tips(cell, base, tool, q):
    return cell.kinematics.tip(q, cell.robot.theta(base, tool))[0]


def touched(cell, base, tool, q):
    """Planes through the tips, looking along all directions."""
    m, tip = len(q), tips(cell, base, tool, q)
    normal = Rotation.random(m, rng=np.random.default_rng(1)).as_matrix()[:, 2]
    blank = ("",) * m
    ids = tuple(map(str, range(m)))
    offset = (normal * tip).sum(axis=1)
    return Touches(ids, blank, q, normal, offset, np.full(m, 0.05), (HIT,) * m, np.full(m, np.nan), blank, blank)


def seen(cell, base, tool, q):
    return Positions(tuple(map(str, range(len(q)))), q, tips(cell, base, tool, q), np.full(len(q), 0.05))


@pytest.mark.parametrize("measure", [touched, seen])
@pytest.mark.parametrize("unknown", [("base",), ("tool",), ("base", "tool")])
def test_what_nobody_measured_is_found_to_a_micrometre(measure, unknown, pointed, rng):
    q = rng.uniform(pointed.robot.lower, pointed.robot.upper, (60, 6))
    hidden = {"base": BASE, "tool": TOOL}
    cell = replace(pointed, **{name: None if name in unknown else hidden[name] for name in hidden})

    theta = starting_point(cell, rows(cell.wire, [measure(cell, BASE, TOOL, q)]))

    np.testing.assert_allclose(transform(theta[:6]), transform(BASE), atol=1e-3)
    np.testing.assert_allclose(theta[-6:-3], TOOL[:3], atol=1e-3)


def test_a_cell_that_states_both_is_taken_at_its_word(pointed, rng):
    q = rng.uniform(pointed.robot.lower, pointed.robot.upper, (5, 6))

    theta = starting_point(pointed, rows(pointed.wire, [seen(pointed, BASE, TOOL, q)]))

    np.testing.assert_array_equal(theta, pointed.theta)


def test_too_few_measurements_are_counted(pointed, rng):
    q = rng.uniform(pointed.robot.lower, pointed.robot.upper, (20, 6))
    cell = replace(pointed, base=None, tool=None)

    with pytest.raises(InputError, match="fit needs at least 39 independent measurements, there are 20"):
        starting_point(cell, rows(cell.wire, [touched(cell, BASE, TOOL, q)]))
