"""Lengths, rates and ends of motions: by finer sampling, and by the speeds that joints and tip may have."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from virtual_support import make_plan

from identify.model.cell import Cell
from identify.model.joint_counting import JointCounting
from probe.motion.joint_path import CREEP, Geometry, reach
from probe.motion.settings import Settings

START, END = np.array([0.1, 0.2, -0.3, 0.2, 0.9, 0.3]), np.array([0.3, 0.1, -0.1, 0.0, 1.1, 0.1])


@pytest.fixture(scope="module")
def geometry(arc_welder: Cell) -> Geometry:
    return Geometry(arc_welder, Settings())


def test_the_way_of_the_tip_is_as_long_as_finer_samples_find(geometry: Geometry) -> None:
    tip = geometry.tip(START + np.linspace(0, 1, 4000)[:, None] * (END - START))

    length = np.linalg.norm(np.diff(tip, axis=0), axis=1).sum()

    assert geometry.length(START, END) == pytest.approx(length, rel=1e-4)


@pytest.mark.parametrize("travel", [5.0, 40.0, 90.0])
def test_the_end_of_a_search_lies_on_its_line_after_the_travel(geometry: Geometry, travel: float) -> None:
    through = START + 0.2 * (END - START)

    end = geometry.beyond(START, through, travel)

    at, off = geometry.fraction(end, START, through)
    assert at > 0
    assert off == pytest.approx(0, abs=1e-9)
    assert geometry.length(START, end) == pytest.approx(travel, rel=1e-3)


def test_a_search_ends_at_a_joint_limit_that_comes_first(geometry: Geometry) -> None:
    robot = geometry.cell.robot
    start = START.copy()
    start[1] = robot.upper[1] - 0.01
    through = start + np.eye(6)[1] * 0.002

    end = geometry.beyond(start, through, 500.0)

    assert end[1] == pytest.approx(robot.upper[1])


@given(st.floats(-0.5, 1.5), st.floats(-1, 1))
def test_a_point_beside_a_line_has_its_fraction_and_its_distance(
    geometry: Geometry, fraction: float, beside: float
) -> None:
    line = END - START
    across = np.array([line[1], -line[0], 0, 0, 0, 0]) / np.abs(line[:2]).max()  # at right angles to the line

    at, off = geometry.fraction(START + fraction * line + 0.01 * beside * across, START, END)

    assert at == pytest.approx(fraction, abs=1e-9)
    assert off == pytest.approx(0.01 * abs(beside), abs=1e-9)


def test_a_move_is_as_fast_as_tip_and_joints_may_be_and_no_faster(arc_welder: Cell) -> None:
    for speed in (50.0, 5000.0):  # the tip is the limit, then a joint
        geometry = Geometry(arc_welder, Settings())
        rate = geometry.move_rate(START, END, speed)

        seconds = geometry.span(START, END) / rate
        joints, tip = np.abs(END - START) / seconds / arc_welder.robot.speed, geometry.length(START, END) / seconds
        assert max(joints.max(), tip / speed) == pytest.approx(1.0)
        np.testing.assert_allclose(np.abs(geometry.velocity(START, END, rate)), np.abs(END - START) / seconds)


def test_the_override_slows_a_move_and_a_motion_that_goes_nowhere_creeps(arc_welder: Cell) -> None:
    full, half = (Geometry(arc_welder, Settings(override=share)) for share in (1.0, 0.5))

    assert half.move_rate(START, END, 100.0) == pytest.approx(0.5 * full.move_rate(START, END, 100.0))
    assert full.move_rate(START, START, 100.0) == CREEP


def test_spans_are_counted_as_the_controller_counts(arc_welder: Cell) -> None:
    coupled = replace(arc_welder.robot, counting=JointCounting(coupled=((2, 1, 1),)))  # j3 shows j2 as well

    span = Geometry(replace(arc_welder, robot=coupled), Settings()).span(START, START + np.eye(6)[1] - np.eye(6)[2])

    assert span == pytest.approx(2.0)  # of j3, whose own angle falls by one while that of joint 2 rises by one


def test_the_reach_is_the_distance_of_the_tip_from_the_farthest_axis(arc_welder: Cell) -> None:
    """A joint that turns by an angle moves the tip along a chord of the circle around its axis."""
    plan, angle = make_plan(arc_welder, 4), 0.3
    q = np.concatenate([plan.q, plan.approach])
    turns = angle * np.eye(q.shape[1])
    ends = [
        arc_welder.kinematics.tip(row + np.stack([turn, -turn]), arc_welder.theta)[0] for row in q for turn in turns
    ]
    farthest = max(float(np.linalg.norm(a - b)) for a, b in ends) / (2 * np.sin(angle))

    assert farthest <= reach(arc_welder, plan) <= 1.2 * farthest
