"""How many targets a second are compensated.

Run with pytest tests/benchmarks/test_compensation.py --benchmark-only.
"""

import numpy as np
import pytest
from identified import identified, poses_at
from measured import poses_over_jig, table_2

from identify.compensation.compensate import allowed_change, compensate

TARGETS = 20_000


@pytest.mark.parametrize("start", ["a posture for each", "none"])
def test_twenty_thousand_targets_are_compensated(benchmark, arc_welder, start):
    q = poses_over_jig(arc_welder, TARGETS, np.random.default_rng(0))
    calibration, poses = identified(arc_welder, table_2(arc_welder)), poses_at(arc_welder, q)
    allowed_change(calibration)  # looked for once a calibration

    result = benchmark(compensate, calibration, poses, near=q if start != "none" else None)

    assert result.corrected.mean() > 0.9
    assert result.residual[result.corrected].max() < 1e-3
