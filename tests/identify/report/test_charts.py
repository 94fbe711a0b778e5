"""Charts tell the numbers of a calibration, checked where these are known by hand."""

import re
from dataclasses import replace

import numpy as np
from identified import identified

from identify.model.io.calibration_file import Residual
from identify.report.charts import correlations, residuals_by_face, residuals_in_time, singular_values, zone_slices
from identify.uncertainty.zone_map import ZoneMap

NAMES = ("base.x", "j2.theta")


def estimated(cell, correlation, share):
    """A calibration of two parameters, deviations a share of what was known before."""
    calibration = identified(cell, cell.theta, estimated=NAMES, covariance=np.eye(2))
    deviation = share * cell.scale[calibration.index]
    R = np.array([[1.0, correlation], [correlation, 1.0]])
    return replace(calibration, covariance=R * np.outer(deviation, deviation))


def hints(chart):
    return re.findall(r"<title>(.*?)</title>", chart)


def test_a_posterior_of_a_quarter_of_the_prior_is_four_times_better_known(arc_welder):
    chart = singular_values(estimated(arc_welder, 0.0, 0.25))

    assert hints(chart) == [f"direction {i}: 4 times better known" for i in (1, 2)]


def test_a_correlation_is_the_one_of_the_covariance(arc_welder):
    chart = correlations(estimated(arc_welder, -0.6, 0.1))

    assert sorted(hints(chart)) == [
        "base.x, base.x: +1.00",
        "base.x, j2.theta: -0.60",
        "j2.theta, base.x: -0.60",
        "j2.theta, j2.theta: +1.00",
    ]


def test_residuals_carry_the_names_of_their_touches_and_stand_on_their_faces(arc_welder):
    residuals = {"t<1>": Residual(3.0, 0.25, True), "t2": Residual(-2.0, -9.0, False)}
    calibration = identified(arc_welder, arc_welder.theta, residuals=residuals)

    in_time, by_face = residuals_in_time(calibration), residuals_by_face(calibration, {"t<1>": "top"})

    assert hints(in_time) == ["t&lt;1&gt;: +0.250 mm", "t2: -9.000 mm"]
    assert hints(by_face) == ["t&lt;1&gt;: 3.000 mm", "t2: 2.000 mm", "t&lt;1&gt;: 0.250 mm", "t2: 9.000 mm"]
    assert "top" in by_face
    assert "plane" in by_face  # a touch that names no face


def test_a_slice_of_the_zone_tells_errors_and_what_is_out_of_reach():
    error = np.array([0.1, 0.2, 0.3, np.nan]).reshape(2, 2, 1)

    slices = zone_slices(ZoneMap(np.array([0.0, 10.0]), np.array([0.0, 20.0]), np.array([5.0]), error))

    assert [h for h in hints(slices) if h] == [
        "(0, 0): 0.100 mm",
        "(0, 20): 0.200 mm",
        "(10, 0): 0.300 mm",
        "out of reach",
    ]
    assert "z = 5 mm" in slices
