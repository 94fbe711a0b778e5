"""Arm and torch feel what they hit."""

import numpy as np
import pytest

from identify.model.base_placement import parked
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
