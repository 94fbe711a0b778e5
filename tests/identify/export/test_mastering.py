"""Joint zeros and frames alone: what they mend, and what they leave."""

import re

import numpy as np
import pytest
from identified import identified
from measured import table_2

from identify.export.exporting import export


def test_zeros_and_frames_alone_suffice_where_nothing_else_is_wrong(arc_welder):
    names, theta = arc_welder.robot.parameters, arc_welder.theta.copy()
    for name, value in {"j2.theta": 0.02, "j3.theta": -0.01, "j5.theta": 0.015, "tool.x": 3.0, "base.z": -5.0}.items():
        theta[names.index(name)] += value

    result = export(identified(arc_welder, theta), "mastering-text")

    text = result.files[".txt"]
    assert result.deviation.max_mm < 1e-3  # six decimals of a degree
    assert float(re.search(r"j2 +(\S+) deg", text)[1]) == pytest.approx(np.degrees(0.02), abs=1e-5)
    assert float(re.search(r"j2 +\S+ deg +(\S+) deg", text)[1]) == pytest.approx(-np.degrees(0.02), abs=1e-5)
    assert re.search(r"j1 +0.000000 deg +0.000000 deg   carried by base or tool", text)
    assert re.search(r"j6 .* carried by base or tool", text)


def test_zeros_and_frames_leave_less_than_nothing_done(arc_welder):
    calibration = identified(arc_welder, table_2(arc_welder))

    text = export(calibration, "mastering-text").files[".txt"]

    nothing, done = (float(re.search(rf"{word}.* (\S+) / \S+ mm", text)[1]) for word in ("nothing done", "these zeros"))
    assert done < 0.5 * nothing
