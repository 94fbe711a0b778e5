"""Which links could hit each other: no neighbours, and none that always overlap."""

from dataclasses import replace

import numpy as np
from cells import cell_of

from identify.model.io.description import library
from identify.model.joint import Capsule
from probe.motion.clearance import Clearance


def test_no_robot_of_the_library_is_in_its_own_way_when_it_stands_straight():
    for name in library("robots"):
        cell = cell_of(name)
        middle = np.clip(np.zeros(len(cell.robot.joints)), cell.robot.lower, cell.robot.upper)

        _, inside = Clearance(cell, cell.theta).gaps(middle[None])

        assert inside[0] > 10, name


def test_capsules_that_overlap_in_most_postures_are_neighbours():
    cell = cell_of("irb120")
    swallowed = Capsule(4, (0.0, 0.0, 0.0), (0.0, 0.0, 10.0), 2000.0)
    robot = replace(cell.robot, capsules=(*cell.robot.capsules, swallowed))

    clearance = Clearance(replace(cell, robot=robot), cell.theta)

    i = clearance.capsules.index(swallowed)
    assert clearance.pairs
    assert all(i not in pair for pair in clearance.pairs)
