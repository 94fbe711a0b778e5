"""Touches as a program makes them: searches through their contacts, joints within limits and speeds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identify.model.files import InputError
from identify.model.io.tables import read_plan
from probe.programs.options import Options
from probe.programs.routine import FASTEST, SLOWEST, near_approaches, routines

PLAN = Path(__file__).with_name("plan.csv")


@pytest.fixture(scope="module")
def cell(arc_welder):
    return arc_welder


@pytest.fixture(scope="module")
def plan(cell):
    return read_plan(PLAN, cell).take(np.arange(4))


def on_line(start, end, point):
    """How far a point is off the line from start to end, and where on it."""
    way, gone = end - start, point - start
    share = gone @ way / (way @ way)
    return np.abs(gone - share * way).max(), share


def test_a_search_of_the_joints_leads_from_the_approach_through_the_contact(cell, plan):
    for i, touch in enumerate(routines(plan, cell, Options(), straight=False)):
        np.testing.assert_allclose(touch.start, plan.approach[i], atol=1e-9)
        np.testing.assert_allclose(touch.legs[-1].q, plan.approach[i], atol=1e-4)
        off, share = on_line(touch.start, touch.end, plan.q[i])
        assert off < 1e-6
        assert 0 < share < 1
        assert touch.seconds == pytest.approx(touch.length / cell.touch.speed)


def test_a_search_of_the_tip_leads_straight_through_the_contact_with_the_wire_as_it_was(cell, plan):
    for i, touch in enumerate(routines(plan, cell, Options(), straight=True)):
        tips, R = cell.kinematics.tip(np.stack([touch.start, touch.end, plan.q[i]]), cell.theta)
        off, share = on_line(*tips)
        assert off < 0.1  # [mm]
        assert 0 < share < 1
        np.testing.assert_allclose(R[1, :, 2], R[0, :, 2], atol=1e-3)
        assert np.linalg.norm(touch.along) == pytest.approx(np.linalg.norm(tips[1] - tips[0]))


def test_no_leg_is_faster_than_an_operator_can_follow(cell, plan):
    for touch in routines(plan, cell, Options(move_speed=5000.0), straight=False):
        for leg in (*touch.legs, touch.back):
            assert SLOWEST <= leg.share <= FASTEST
            assert leg.speed <= FASTEST * cell.robot.speed.max() * (1 + 1e-9)


def test_a_rehearsal_stays_farther_off(cell, plan):
    usual, off = (routines(plan, cell, Options(rehearsal=r), straight=False) for r in (False, True))

    assert all(a.further < 0.01 < b.further for a, b in zip(usual, off, strict=True))


def test_approaches_that_are_rehearsed_from_nearer_are_named(cell, plan):
    off = routines(plan, cell, Options(rehearsal=True), straight=False)
    near = [replace(off[0], further=3.0), *off[1:]]

    (note,) = near_approaches(near)

    assert f"1 of 4 approaches are rehearsed from less than {max(t.further for t in off):.0f} mm" in note
    assert f"{off[0].id} (3 mm)" in note
    same = [replace(touch, further=25.0) for touch in off]
    assert near_approaches(same) == ()


def test_arms_that_programs_are_not_written_for_are_refused(arc_welder, plan):
    robot = arc_welder.robot
    seven = replace(robot, joints=(*robot.joints, replace(robot.joints[0], name="j7")))

    with pytest.raises(InputError, match=r"has 7 joints .*programs move 6 that turn"):
        routines(plan, replace(arc_welder, robot=seven), Options(), straight=False)
