"""A robot that no geometry describes."""

from dataclasses import replace

import numpy as np
import pytest
from exported import cell_of
from identified import identified

from identify.model.io.description import library, read_robot


@pytest.fixture
def bending(rng):
    """A calibration of a robot that bends and turns unevenly."""
    cell = cell_of(read_robot(library("robots")["irb120"]))
    cell = replace(cell, robot=replace(cell.robot, errors=("harmonics", "compliance")))
    theta = cell.theta.copy()
    theta[11] += np.radians(0.3)  # of joint 2: weights hang where the drawing has them
    theta[36:-6] = 0.5 * cell.scale[36:-6] * rng.standard_normal(len(theta) - 42)
    return identified(cell, theta)
