"""A calibration that knows the robot exactly."""

import pytest
from identified import identified
from measured import table_2


@pytest.fixture(scope="module")
def exact(arc_welder):
    """A calibration that knows the paper's robot exactly."""
    return identified(arc_welder, table_2(arc_welder))
