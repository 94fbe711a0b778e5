"""Equations of every kind: slopes that differences confirm."""

import numpy as np
import pytest
from instruments import equations

from identify.model.measurement import MEASUREMENTS, measurement_model, spacing_rows

STEP = 1e-6


@pytest.mark.parametrize("kind", MEASUREMENTS)
def test_slopes_are_those_of_differences(kind, arc_welder, q, rng):
    found, model = equations(kind, arc_welder, q), measurement_model(arc_welder.robot)
    theta = arc_welder.theta + 0.1 * arc_welder.scale * rng.standard_normal(len(arc_welder.theta))

    J = model.linearize(theta, found)[1]

    for k in range(len(theta)):
        step = STEP * arc_welder.scale[k]
        up, down = (model.residual(theta + sign * step * np.eye(len(theta))[k], found) for sign in (1, -1))
        np.testing.assert_allclose((up - down) / (2 * step), J[:, k], rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("kind", ["distance", "contact"])
def test_slopes_by_the_coordinates_of_a_point_are_those_of_differences(kind, arc_welder, q):
    from dataclasses import replace

    found, model = equations(kind, arc_welder, q), measurement_model(arc_welder.robot)

    P = model.linearize_with_points(arc_welder.theta, found)[2]

    for k in range(3):
        step = STEP * np.eye(6)[k]
        up, down = (
            model.residual(arc_welder.theta, replace(found, places=found.places + sign * step)) for sign in (1, -1)
        )
        np.testing.assert_allclose((up - down) / (2 * STEP), P[:, k], atol=1e-6)


def test_the_spacing_of_two_points_needs_no_robot(arc_welder):
    places = {"a": np.array([0.0, 0.0, 0.0]), "b": np.array([30.0, 40.0, 0.0])}
    found = spacing_rows([("a", "b", 49.0, 0.02)], places, 6)

    r, J, P = measurement_model(arc_welder.robot).linearize_with_points(arc_welder.theta, found)

    np.testing.assert_allclose(r, 1.0, atol=1e-6)
    assert not J.any()
    np.testing.assert_allclose(P, [[-0.6, -0.8, 0.0, 0.6, 0.8, 0.0]], atol=1e-6)
