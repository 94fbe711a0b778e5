"""Everything that may have changed has a direction and a size."""

from cells import cell_of
from identified import identified

from identify.health.causes import causes


def test_every_robot_has_causes_with_a_direction_and_a_size(rng):
    for robot in ("irb120", "scara", "arm7"):
        cell = cell_of(robot)
        for cause in causes(identified(cell, cell.theta)):
            assert cause.directions.shape == (len(cell.theta), len(cause.size))
            assert (cause.size > 0).all()
