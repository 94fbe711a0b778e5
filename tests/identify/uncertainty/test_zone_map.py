"""The map of the zone: a point that the robot reaches is no grey one."""

from dataclasses import replace

import numpy as np
from identified import identified

from identify.model.cell import Zone
from identify.model.ik import reach
from identify.uncertainty.zone_map import zone_map


def test_points_that_are_left_out_are_reached_from_none_of_many_starts(arc_welder):
    wide = replace(arc_welder, zone=Zone(np.array([[-300.0, 700.0], [-400.0, 500.0], [0.0, 400.0]])))

    found = zone_map(identified(wide, wide.theta))

    point = np.stack(np.meshgrid(found.x, found.y, found.z, indexing="ij"), axis=-1)[np.isnan(found.error)]
    assert 0 < len(point) < 0.7 * found.error.size
    rng, robot = np.random.default_rng(7), wide.robot
    reached = np.zeros(len(point), dtype=bool)
    for _ in range(100):
        start = rng.uniform(robot.lower, robot.upper, (len(point), 6))
        down = np.tile(np.diag([1.0, -1.0, -1.0]), (len(point), 1, 1))
        reached |= reach(wide.kinematics, wide.theta, point, down, start, free_roll=True).reached()
    assert not reached.any()
