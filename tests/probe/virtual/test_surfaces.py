"""What a wire can touch: the faces and boxes of the jig, wherever it is driven."""

import numpy as np
import pytest

from identify.model.base_placement import parked
from identify.model.cell import Cell
from identify.model.ik import reach
from probe.virtual.contact import Paths, touching
from probe.virtual.robot import VirtualRobot
from probe.virtual.surfaces import surfaces

FAST, SLOW = np.radians(60), np.radians(0.6)


@pytest.mark.ghost
def test_the_contact_reads_what_the_jig_says_wherever_a_robot_is_driven_that_does_not_look(arc_welder, exact, rng):
    corner, surface = np.array([350.0, 250.0, 80.0]), surfaces(arc_welder.jig, arc_welder.wire)
    kinematics, none = arc_welder.kinematics, np.zeros(1)
    seen = set()
    for _ in range(12):
        ends = corner + rng.uniform(-8, 8, (2, 3)) + np.array([[30.0, -30, 0], [-30, 30, 0]])
        start, end = posed(arc_welder, ends)
        robot = VirtualRobot(arc_welder, exact, rng, start=start)
        robot.begin("MOVE", end, SLOW, watch=False)

        for time in np.linspace(0, robot.due, 40)[:-1]:
            robot.advance(time)
            here = Paths(robot.q[None], robot.q[None], arc_welder.theta)
            expected = bool(touching(kinematics, surface, here, none, none)[0])
            assert robot.contact == expected
            seen.add(expected)
        robot.advance(1e9)
        assert not robot.contact

    assert seen == {True, False}


def posed(cell: Cell, tips: np.ndarray) -> np.ndarray:
    """Joint values for tips beside the jig, the torch straight down."""
    down = np.tile(np.diag([1.0, -1.0, -1.0]), (len(tips), 1, 1))
    start = np.tile(parked(cell), (len(tips), 1))
    found = reach(cell.kinematics, cell.theta, tips, down, start, free_roll=True)
    assert found.reached().all()
    return found.q
