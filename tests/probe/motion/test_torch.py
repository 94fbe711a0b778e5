"""The torch as capsules: bare wire, nozzle, body."""

from dataclasses import replace

import numpy as np
import pytest
from cells import cell_of

from identify.model.cell import DEG
from identify.model.joint import Capsule
from probe.motion.clearance import Clearance
from probe.motion.torch import NOZZLE, STICKOUT, torch


@pytest.mark.parametrize("ry", [0.0, -18.0, -90.0])
def test_a_torch_leaves_the_end_of_the_wire_bare_and_ends_at_the_flange(ry):
    cell = replace(cell_of("arc-welder"), tool=np.array([20.0, 0, 400, 0, ry * DEG, 0]))

    nozzle, body = torch(cell)

    tip, wire = np.array([20.0, 0, 400]), np.array([np.sin(ry * DEG), 0, np.cos(ry * DEG)])
    assert np.cross(np.array(nozzle.start) - tip, wire) == pytest.approx(0, abs=1e-9)
    assert (tip - nozzle.start) @ wire - NOZZLE * (1 - np.sin(50 * DEG)) / np.cos(50 * DEG) == pytest.approx(
        STICKOUT, abs=0.1
    )
    assert nozzle.end == body.end
    assert np.linalg.norm(body.start) == pytest.approx(30)
    assert {nozzle.link, body.link} == {6}


def test_capsules_on_the_last_link_stand_for_the_torch():
    cell = cell_of("arc-welder")
    own = Capsule(6, (0.0, 0.0, 0.0), (0.0, 0.0, 300.0), 15.0)
    robot = replace(cell.robot, capsules=(*cell.robot.capsules, own))

    assert torch(replace(cell, robot=robot)) == (own,)
    assert Clearance(replace(cell, robot=robot), cell.theta).capsules[-1] == own


def test_a_short_pointer_has_no_torch():
    cell = replace(cell_of("arc-welder"), tool=np.array([0.0, 0, 30, 0, 0, 0]))

    assert torch(cell) == ()
