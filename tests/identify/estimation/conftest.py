"""Where robots touch in tests of what residuals give away."""

import numpy as np
import pytest
from findings import TOUCHES
from measured import poses_over_jig


@pytest.fixture(scope="session")
def touch_poses(arc_welder):
    return poses_over_jig(arc_welder, TOUCHES, np.random.default_rng(7))
