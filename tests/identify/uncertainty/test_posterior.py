"""What a calibration says of all unknowns: its covariance for those that it knows, the prior for the others."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identified

from identify.model.files import InputError
from identify.model.io.calibration_file import Discrepancy
from identify.uncertainty.posterior import posterior, tip_errors, zone_promise

NAMES = ("base.x", "j2.theta", "tool.z")


@pytest.fixture
def calibration(arc_welder, rng):
    root = rng.standard_normal((3, 3)) * np.array([[0.1], [1e-4], [0.05]])
    return identified(arc_welder, arc_welder.theta, estimated=NAMES, covariance=root @ root.T)


def test_parameters_have_the_covariance_of_the_calibration_and_faces_that_of_their_tolerances(calibration, arc_welder):
    information = posterior(calibration)

    np.testing.assert_allclose(information.covariance(NAMES), calibration.covariance, rtol=1e-6)
    face = arc_welder.jig.faces[0]
    variance = information.covariance((f"face.{face.name}",))[0, 0]
    assert variance == pytest.approx(face.tolerance**2)


def test_the_error_of_the_tip_is_that_of_parameters_and_of_scatter_beyond_what_was_stated(calibration, rng):
    q = rng.uniform(-0.5, 0.5, (4, 6))
    scattered = replace(calibration, discrepancy=Discrepancy(noise=2.0))

    plain, wide = (tip_errors(c, q).variance() for c in (calibration, scattered))

    trace = np.trace(calibration.tip_covariance(q), axis1=1, axis2=2)
    np.testing.assert_allclose(plain, trace, rtol=1e-6)
    excess = calibration.cell.touch.sigma**2 * (2.0**2 - 1)  # of each axis
    np.testing.assert_allclose(wide, trace + 3 * excess, rtol=1e-6)


def test_a_promise_of_the_file_holds(calibration):
    promise = zone_promise(replace(calibration, promise={"rms_mm": 0.1, "p95_mm": 0.25}))

    assert (promise.rms_mm, promise.p95_mm) == (0.1, 0.25)


def test_a_calibration_of_a_robot_with_other_parameters_is_refused(calibration, arc_welder):
    other = replace(arc_welder, robot=replace(arc_welder.robot, errors=("harmonics",)))

    with pytest.raises(InputError, match="the calibration is of robot 'arc-welder' with other parameters"):
        posterior(calibration, other)
