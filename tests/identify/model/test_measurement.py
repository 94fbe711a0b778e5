"""Every kind of measurement: zero at what the oracle measures, slopes that differences confirm, and named points."""

import numpy as np
import pytest
from oracle import forward

from identify.model.cell import Wire
from identify.model.frames import euler
from identify.model.measurement import MEASUREMENTS, measurement_model, rows, spacing_rows
from identify.model.touch import HIT, Contacts, Distances, Poses, Positions, Touches

STEP = 1e-6
ANCHOR = np.array([150.0, 90.0, -40.0])


def measured(kind, cell, q):
    """What an exact instrument reads of each kind, by kinematics written independently."""
    frames = np.stack([forward(cell.robot, row, cell.theta) for row in q])
    tip, m = frames[:, :3, 3], len(q)
    ids, sigma, blank = tuple(map(str, range(m))), np.full(m, 0.1), ("",) * m
    if kind == "touch":
        normal = np.eye(3)[np.arange(m) % 3]
        offset = (normal * tip).sum(axis=1)
        return Touches(ids, blank, q, normal, offset, sigma, (HIT,) * m, np.full(m, np.nan), blank, blank)
    if kind == "position":
        return Positions(ids, q, tip, sigma)
    if kind == "pose":
        return Poses(ids, q, tip, euler(frames[:, :3, :3]), sigma, sigma / 100)
    if kind == "distance":
        return Distances(ids, q, ("pin",) * m, np.linalg.norm(tip - ANCHOR, axis=1), sigma)
    return None


@pytest.fixture
def q(arc_welder, rng):
    return rng.uniform(arc_welder.robot.lower, arc_welder.robot.upper, (6, 6))


def equations(kind, cell, q):
    point = Wire(0.0, "point")
    if kind == "contact":  # each pose in a socket of its own
        tip = np.stack([forward(cell.robot, row, cell.theta)[:3, 3] for row in q])
        names = tuple(f"hole{i}" for i in range(len(q)))
        table = Contacts(tuple(map(str, range(len(q)))), q, names, np.full(len(q), 0.1))
        return rows(point, [table], places=dict(zip(names, tip, strict=True)))
    return rows(point, [measured(kind, cell, q)], places={"pin": ANCHOR})


@pytest.mark.parametrize("kind", MEASUREMENTS)
def test_what_an_exact_instrument_reads_leaves_no_residual(kind, arc_welder, q):
    found = equations(kind, arc_welder, q)

    r = measurement_model(arc_welder.robot).residual(arc_welder.theta, found)

    assert len(found) == len(q) * {"touch": 1, "distance": 1, "pose": 6}.get(kind, 3)
    np.testing.assert_allclose(r, 0, atol=1e-6)


@pytest.mark.parametrize("kind", MEASUREMENTS)
def test_slopes_are_those_of_differences(kind, arc_welder, q, rng):
    found, model = equations(kind, arc_welder, q), measurement_model(arc_welder.robot)
    theta = arc_welder.theta + 0.1 * arc_welder.scale * rng.standard_normal(len(arc_welder.theta))

    J = model.linearize(theta, found)[1]

    for k in range(len(theta)):
        step = STEP * arc_welder.scale[k]
        up, down = (model.residual(theta + sign * step * np.eye(len(theta))[k], found) for sign in (1, -1))
        np.testing.assert_allclose((up - down) / (2 * step), J[:, k], rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("kind", ["distance", "contact"])
def test_slopes_by_the_coordinates_of_a_point_are_those_of_differences(kind, arc_welder, q):
    from dataclasses import replace

    found, model = equations(kind, arc_welder, q), measurement_model(arc_welder.robot)

    P = model.linearize_with_points(arc_welder.theta, found)[2]

    for k in range(3):
        step = STEP * np.eye(6)[k]
        up, down = (
            model.residual(arc_welder.theta, replace(found, places=found.places + sign * step)) for sign in (1, -1)
        )
        np.testing.assert_allclose((up - down) / (2 * STEP), P[:, k], atol=1e-6)


def test_the_spacing_of_two_points_needs_no_robot(arc_welder):
    places = {"a": np.array([0.0, 0.0, 0.0]), "b": np.array([30.0, 40.0, 0.0])}
    found = spacing_rows([("a", "b", 49.0, 0.02)], places, 6)

    r, J, P = measurement_model(arc_welder.robot).linearize_with_points(arc_welder.theta, found)

    np.testing.assert_allclose(r, 1.0, atol=1e-6)
    assert not J.any()
    np.testing.assert_allclose(P, [[-0.6, -0.8, 0.0, 0.6, 0.8, 0.0]], atol=1e-6)


def test_kinds_stand_beside_each_other_as_they_would_alone(arc_welder, q):
    tables = [measured(kind, arc_welder, q) for kind in ("touch", "pose", "distance", "position")]
    point, model = Wire(0.0, "point"), measurement_model(arc_welder.robot)
    theta = arc_welder.theta + 0.01 * arc_welder.scale

    together = model.linearize(theta, rows(point, tables, places={"pin": ANCHOR}))
    alone = [model.linearize(theta, rows(point, [table], places={"pin": ANCHOR})) for table in tables]

    for k in (0, 1):
        np.testing.assert_allclose(together[k], np.concatenate([one[k] for one in alone]), rtol=1e-12, atol=1e-12)


def test_a_turn_of_the_tool_is_seen_by_a_pose_as_a_distance_at_a_lever(arc_welder, q):
    found, model = equations("pose", arc_welder, q), measurement_model(arc_welder.robot)
    theta = arc_welder.theta.copy()
    theta[-3] += 1e-4

    r = model.residual(theta, found).reshape(len(q), 6)

    np.testing.assert_allclose(np.linalg.norm(r[:, 3:], axis=1), 100 * 1e-4, rtol=1e-3)
