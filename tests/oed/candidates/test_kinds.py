"""Measurements that can be made: within reach, view and cone, clear of the jig, and reading what the robot gives."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.cell import Device, Point
from identify.model.files import InputError
from identify.model.measurement import measurement_model, rows
from oed.candidates.kinds import POSTURES, measurements, planned_cell
from probe.motion.clearance import CLEAR, Clearance

ANCHORS = {"a": Point(np.array([450.0, -50.0, 10.0]), 0.05), "b": Point(np.array([-50.0, 350.0, 10.0]))}
BAR = Device(range=(400.0, 400.0), max_tilt=np.radians(70))


@pytest.fixture(scope="module")
def cell(arc_welder):
    return replace(arc_welder, points=ANCHORS, devices={"distance": BAR})


@pytest.mark.parametrize("kind", POSTURES)
def test_what_is_planned_is_clear_within_the_limits_and_what_the_drawn_robot_reads(cell, kind, rng):
    table = measurements(cell, kind, rng, 40)[0]

    made = rows(cell.wire, [table], places=cell.places)
    assert len(table) == 40
    assert (Clearance(cell, cell.theta).hits(table.q) == CLEAR).all()
    assert ((table.q >= cell.robot.lower - 1e-6) & (table.q <= cell.robot.upper + 1e-6)).all()
    assert np.abs(measurement_model(cell.robot).residual(cell.theta, made)).max() < 1e-2  # [mm], of a length of 1e-3


def test_a_ball_bar_is_as_long_as_it_is_and_leans_no_more_than_allowed(cell, rng):
    table = measurements(cell, "distance", rng, 60)[0]

    anchor = np.array([cell.places[name] for name in table.anchor])
    along = cell.kinematics.tip(table.q, cell.theta)[0] - anchor
    assert np.linalg.norm(along, axis=1) == pytest.approx(400, abs=1e-3)
    assert np.degrees(np.arccos(along[:, 2] / 400)).max() < 70.01
    assert set(table.anchor) == {"a", "b"}


def test_a_tool_comes_to_a_socket_within_the_cone(cell, rng):
    steep = replace(cell, devices={"contact": Device(max_tilt=np.radians(20))})

    table = measurements(steep, "contact", rng, 30)[0]

    R = cell.kinematics.tip(table.q, cell.theta)[1]
    assert np.degrees(np.arccos(-R[:, 2, 2])).max() < 20.01


def test_a_tracker_sees_the_tip_in_its_box_alone(cell, rng):
    box = np.array([[0.0, 400.0], [0.0, 300.0], [100.0, 300.0]])
    seen = replace(cell, devices={"position": Device(box=box)})

    point = measurements(seen, "position", rng, 30)[0].point

    assert (point >= box[:, 0]).all()
    assert (point <= box[:, 1]).all()


def test_further_tools_and_placements_take_part_as_the_first_ones_do(cell, rng):
    frame = np.array([30.0, 0.0, 380.0, 0.0, 0.0, 0.0])
    several = replace(cell, tools={"smr2": frame}, placements={"second": cell.base + np.array([50.0, 0, 0, 0, 0, 0])})

    table = measurements(several, "position", rng, 80)[0]

    assert set(table.tool) == {"", "smr2"}
    assert set(table.placement) == {"", "second"}
    i = table.tool.index("smr2")
    theta = np.concatenate([cell.theta[:-6], frame])
    theta[:6] = several.placements["second"] if table.placement[i] else cell.base
    np.testing.assert_allclose(cell.kinematics.tip(table.q[i : i + 1], theta)[0][0], table.point[i], atol=1e-9)


def test_what_is_to_be_fitted_is_left_out_and_named(cell):
    loose = replace(cell, points={**ANCHORS, "c": Point(None)}, tools={"smr2": None})

    planned, (note,) = planned_cell(loose)

    assert set(planned.points) == {"a", "b"}
    assert not planned.tools
    assert "smr2, c" in note


def test_a_kind_without_its_points_is_refused_with_what_it_needs(arc_welder, rng):
    with pytest.raises(InputError, match="points: with the anchors"):
        measurements(arc_welder, "distance", rng, 10)
