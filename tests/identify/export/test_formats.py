"""How far an export is off is told as a way and as an angle."""

import numpy as np
import pytest
from identified import identified

from identify.compensation.compensate import tip_transform
from identify.export.formats import deviation
from identify.model.frames import transform


def test_a_tip_displaced_and_turned_by_known_amounts_deviates_by_these(arc_welder):
    calibration = identified(arc_welder, arc_welder.theta)
    change = transform(np.array([2.0, 3.0, 6.0, 0.0, 0.02, 0.0]))  # 7 mm, 0.02 rad

    result = deviation(calibration, lambda q: tip_transform(calibration, q, calibration.theta) @ change)

    assert result.mean_mm == pytest.approx(7.0)
    assert result.max_mm == pytest.approx(7.0)
    assert result.max_deg == pytest.approx(np.degrees(0.02))
