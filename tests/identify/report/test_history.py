"""What has changed since earlier calibrations: a planted change is shown, and no other."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.files import InputError
from identify.report.history import changes, history


def moved(calibration, name, by):
    """The calibration with one parameter changed, in [mm] or [rad]."""
    step = np.array([by if n == name else 0.0 for n in calibration.cell.robot.parameters])
    return replace(calibration, theta=calibration.theta + step)


def test_a_tool_that_moved_is_the_first_parameter_and_moves_the_tip_as_far(found):
    later = moved(found, "tool.z", 2.0)

    (change,) = changes(later, [("old.json", found)])
    page = history(later, [("old.json", found)])

    assert change.parameters[later.cell.robot.parameters.index("tool.z")] == pytest.approx(2.0)
    assert np.count_nonzero(change.parameters) == 1
    assert change.tip.mean_mm == pytest.approx(2.0, abs=1e-9)
    assert page.index("tool.z [mm]") < page.index("+2.000 +-") < page.index(" *</td>")


def test_without_a_change_nothing_is_listed(found):
    page = history(found, [("old.json", found)])

    assert "0.000" in page
    assert "[mm]" not in page
    assert "[deg]" not in page


def test_the_deviation_of_a_change_is_that_of_two_independent_estimates(found):
    (change,) = changes(found, [("old.json", found)])

    np.testing.assert_allclose(change.sigma, np.sqrt(2) * found.sigma)


def test_a_calibration_of_another_robot_is_refused(found):
    robot = replace(found.cell.robot, name="another")
    other = replace(found, cell=replace(found.cell, robot=robot))

    with pytest.raises(InputError, match=r"old\.json is a calibration of robot 'another', not of 'arc-welder'"):
        changes(found, [("old.json", other)])
