"""Arm and torch feel what they hit."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.base_placement import parked
from identify.model.shape import Shape
from probe.virtual.robot import VirtualRobot

FAST, SLOW = np.radians(60), np.radians(0.6)


@pytest.mark.collides
def test_an_arm_that_hits_the_table_stops_the_robot_and_is_recorded_though_the_wire_is_clear(arc_welder, exact, rng):
    start = parked(arc_welder)
    fallen = start + np.radians([0, 90, 0, 0, 0, 0])  # the upper arm goes down with all that hangs on it
    robot = VirtualRobot(arc_welder, exact, rng, start=start)

    outcome = robot.move(np.clip(fallen, arc_welder.robot.lower, arc_welder.robot.upper), SLOW)

    assert outcome.kind == "ESTOP"
    assert " has hit " in outcome.text
    assert len(robot.collisions) == 1
    assert robot.move(start, SLOW).kind == "ESTOP"  # a person has to look first


def test_a_mesh_of_a_kind_that_is_not_read_is_felt_by_nothing(arc_welder, exact, rng, tmp_path):
    shape = Shape(2, "forearm", "mesh", (1.0, 1.0, 1.0), np.eye(4), "forearm.dae", tmp_path / "forearm.dae")
    robot = replace(arc_welder.robot, shapes=(shape,))
    start = parked(arc_welder)

    outcome = VirtualRobot(replace(arc_welder, robot=robot), exact, rng, start=start).move(start + 0.01, SLOW)

    assert not shape.readable
    assert outcome.kind == "OK"
