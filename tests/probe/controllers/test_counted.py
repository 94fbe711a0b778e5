"""A controller that counts otherwise: the line carries its numbers, the driver and the arm the model's."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.joint_counting import JointCounting
from probe.controllers import open_controller
from probe.line.clock import Clock
from probe.virtual.server import serve
from probe.virtual.truth import draw_truth

ODD = JointCounting((1, -1, 1, 1, -1, 1), (0.0, 90.0, 0.0, -12.5, 0.0, 180.0), ((2, 1, 1),))
TARGET = np.radians([3.0, -2.0, 4.0, 5.0, -6.0, 7.0])


@pytest.fixture
def counted(arc_welder):
    return replace(arc_welder, robot=replace(arc_welder.robot, counting=ODD))


@pytest.mark.parametrize("protocol", ["line", "grbl"])
def test_the_line_carries_the_controllers_numbers_and_the_arm_goes_where_the_model_says(counted, protocol):
    truth = draw_truth(counted, np.random.default_rng(3), scale=0.1)
    start = np.zeros(6)
    with serve(counted, truth, protocol=protocol, speed=np.inf, start=start) as served:
        controller = open_controller(served.url, protocol, counted.robot, clock=Clock(robot=served.clock.now))

        before = controller.state().q
        arrived = controller.move(TARGET, np.radians(20.0))
        controller.close()

        np.testing.assert_allclose(before, start, atol=2e-5)
        np.testing.assert_allclose(arrived, TARGET, atol=2e-5)
        np.testing.assert_allclose(served.robot.q, TARGET, atol=2e-5)
        # joint 2 is shown as 90 - q, joint 3 without what joint 2 shows
        shown = [f"{degrees:.3f}" for degrees in (92.0, 4.0 - 92.0, 6.0)]
        assert any(all(number in line.decode() for number in shown) for line in served.heard)
