"""Readings of a hidden robot: exact without scatter, of frames and points as they truly are."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.cell import Device, Point
from identify.model.frames import rotation
from identify.model.measurement import rows
from oed.candidates.kinds import measurements
from probe.virtual.readings import draw_named, readings

TINY = 1e-9
SPREAD = {"position": Device(sigma=TINY), "distance": Device(sigma=TINY), "contact": Device(sigma=TINY)}


@pytest.fixture(scope="module")
def cell(arc_welder):
    points = {"a": Point(np.array([450.0, -50.0, 10.0]), 2.0), "b": Point(np.array([60.0, 40.0, 300.0]), 0.0)}
    devices = SPREAD | {"pose": Device(sigma=TINY, turn_sigma=TINY)}
    second = arc_welder.theta[:6] + np.array([80.0, 0, 0, 0.1, 0, 0])
    return replace(arc_welder, points=points, devices=devices, placements={"second": second})


@pytest.fixture(scope="module")
def truth(cell):
    rng = np.random.default_rng(2)
    return cell.theta + 0.1 * cell.spread * rng.standard_normal(len(cell.theta)), draw_named(cell, rng)


def bases(cell, truth, table):
    theta, further = truth
    each = np.tile(theta, (len(table), 1))
    for i, name in enumerate(table.placement or ()):
        if name:
            each[i, :6] = further["placement.second"]
    return each


def test_positions_and_poses_are_those_of_the_hidden_tip_in_its_own_placement(cell, truth, rng):
    for kind in ("position", "pose"):
        made = readings(cell, measurements(cell, kind, rng, 30)[0], truth[0], rng, truth[1])

        tip, R = cell.kinematics.tip(made.q, bases(cell, truth, made))
        np.testing.assert_allclose(made.point, tip, atol=1e-6)
        if kind == "pose":
            np.testing.assert_allclose(rotation(*made.angles.T), R, atol=1e-6)
    assert set(made.placement) == {"", "second"}


def test_distances_are_those_from_where_the_anchor_truly_is(cell, truth, rng):
    made = readings(cell, measurements(cell, "distance", rng, 30)[0], truth[0], rng, truth[1])

    anchor = np.array([truth[1]["point.a"] if name == "a" else cell.places["b"] for name in made.anchor])
    tip = cell.kinematics.tip(made.q, truth[0])[0]
    np.testing.assert_allclose(made.distance, np.linalg.norm(tip - anchor, axis=1), atol=1e-5)


def test_contacts_bring_the_hidden_tip_to_where_the_point_truly_is(cell, truth, rng):
    planned = measurements(cell, "contact", rng, 30)[0]

    made = readings(cell, planned, truth[0], rng, truth[1])

    at = np.array([truth[1]["point.a"] if name == "a" else cell.places["b"] for name in made.point])
    np.testing.assert_allclose(cell.kinematics.tip(made.q, truth[0])[0], at, atol=1e-3)
    assert 20 < len(made) <= 30


def test_readings_scatter_as_their_table_says(cell, truth):
    planned = measurements(cell, "distance", np.random.default_rng(0), 400)[0]
    planned = replace(planned, sigma=np.full(400, 0.2))

    first, second = (readings(cell, planned, truth[0], np.random.default_rng(seed), truth[1]) for seed in (1, 2))

    assert np.std(first.distance - second.distance) == pytest.approx(0.2 * np.sqrt(2), rel=0.12)
    assert len(rows(cell.wire, [first], places=cell.places)) == 400


def test_touches_are_not_read(cell, truth, found, rng):
    from identify.model.touch import Touches

    blank = np.empty((0, 6))
    touches = Touches((), (), blank, np.empty((0, 3)), *(np.empty(0),) * 2, (), np.empty(0), (), ())
    with pytest.raises(ValueError, match="touch_batch"):
        readings(cell, touches, truth[0], rng)
