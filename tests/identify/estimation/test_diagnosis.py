"""What identify says of faults in touches or robot: each planted fault is named, and sound touches are not accused."""

from dataclasses import replace

import numpy as np
import pytest
from findings import SIGMA, findings
from irb120 import positions
from measured import TABLE_2, positions_at, table_2, touches_at

from identify.estimation.selection import with_errors


def test_a_joint_that_turns_unevenly_is_named(arc_welder, touch_poses, rng):
    uneven = with_errors(arc_welder, ("harmonics",))
    theta = uneven.theta.copy()
    for name, value in TABLE_2.items():
        i = uneven.robot.parameters.index(name)
        theta[i] = value * uneven.robot.parameter_unit()[i]
    theta[uneven.robot.parameters.index("j3.cos2")] = np.radians(0.15)
    theta[uneven.robot.parameters.index("j3.sin2")] = np.radians(0.1)

    found = findings(arc_welder, positions_at(uneven, theta, touch_poses, rng, SIGMA))

    assert "j3 turns unevenly" in found["one bad joint"].text


def test_joints_read_back_before_the_robot_settled_are_recognised(irb120_cell, irb120_measured):
    everything = np.arange(500)

    early = findings(irb120_cell, positions(irb120_measured, everything, "readback"))
    commanded = findings(irb120_cell, positions(irb120_measured, everything))

    assert "wait until it stands" in early["joints read too early"].text
    assert "joints read too early" not in commanded


def test_touches_left_out_are_findings_with_their_names(arc_welder, touch_poses, rng):
    touches = touches_at(arc_welder, table_2(arc_welder), touch_poses, rng, SIGMA)
    offset = touches.offset.copy()
    offset[17] += 3.0

    found = findings(arc_welder, replace(touches, offset=offset))

    assert touches.ids[17] in found["outliers"].ids
    assert float(found["outliers"].text.split("by ")[1].split()[0]) == pytest.approx(-3.0, abs=0.2)
