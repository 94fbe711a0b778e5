"""What is known before and after touches, held against simulated estimates."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.cell import Priors, Wire
from identify.model.files import InputError
from identify.model.measurement import measurement_model
from identify.model.measurement import rows as measured_rows
from identify.model.touch import Touches
from identify.uncertainty.information import (
    built_knowledge,
    drawn,
    face_tolerance,
    knowledge_after,
    nominal_knowledge,
    touch_sigma,
)
from oed.design.relaxation import approximate_design

ROBOTS = 4000


@pytest.fixture(scope="module")
def known(arc_welder):
    return nominal_knowledge(arc_welder)


@pytest.fixture(scope="module")
def touches(arc_welder):
    """Forty postures all over the joint range, each called a touch of some face: what matters here is linear."""
    rng, robot = np.random.default_rng(4), arc_welder.robot
    faces = rng.choice(list(arc_welder.jig.by_name), 40)
    q = rng.uniform(robot.lower, robot.upper, (40, len(robot.joints)))
    normal = np.stack([arc_welder.jig.by_name[name].normal for name in faces])
    return q, normal, tuple(faces.tolist())


def test_rows_are_those_of_the_estimator_scaled_by_priors_and_scatter(arc_welder, known, touches):
    q, normal, faces = touches
    sigma, m = touch_sigma(arc_welder, faces), len(q)
    made = Touches(("",) * m, faces, q, normal, np.zeros(m), sigma, ("hit",) * m, np.zeros(m), ("",) * m, ("",) * m)

    rows = known.rows(q, normal, sigma)

    J = measurement_model(arc_welder.robot).linearize(arc_welder.theta, measured_rows(arc_welder.wire, [made]))[1]
    assert rows == pytest.approx(J[:, known.kept] / sigma[:, None] * arc_welder.scale[known.kept])


def test_the_predicted_error_is_that_of_simulated_estimates(arc_welder, touches, rng):
    """Robots from the priors, faces off together, touches scattered, all linear: the tip error after the estimate.

    Of a pointed wire: the end of a flat one shows a little of parameters that are eliminated, as scatter.
    """
    q, normal, faces = touches
    cell = replace(arc_welder, wire=Wire(0.0, "point"))
    known, sigma = nominal_knowledge(cell), touch_sigma(cell, faces)
    F = known.rows(q, normal, sigma)
    J = np.stack([known.cell.kinematics.tip_jacobian(q, cell.theta)[1][:, k] for k in range(3)], axis=1)
    all_rows = np.einsum("mk,mkp->mp", normal, J)  # of all parameters, per touch [mm]
    zone = known.cell.kinematics.tip_jacobian(q[:10], cell.theta)[1].reshape(30, -1)
    off = cell.prior * rng.standard_normal((ROBOTS, len(cell.theta)))
    names, where = np.unique(faces, return_inverse=True)
    shift = (face_tolerance(cell, tuple(names.tolist())) * rng.standard_normal((ROBOTS, len(names))))[:, where]
    y = (off @ all_rows.T + shift + cell.touch.sigma * rng.standard_normal((ROBOTS, len(q)))) / sigma
    x = y @ F @ known.covariance(F)
    error = off @ zone.T - x @ known.tip_rows(q[:10]).reshape(30, -1).T

    predicted = (
        known.tip_rows(q[:10]).reshape(30, -1) @ known.error(F, faces) @ known.tip_rows(q[:10]).reshape(30, -1).T
    )

    assert np.sqrt((error**2).mean()) == pytest.approx(np.sqrt(np.trace(predicted) / 30), rel=0.03)  # 4000 robots


def test_touches_made_again_and_again_leave_only_what_the_faces_are_off_by(arc_welder, known, touches):
    q, normal, faces = touches
    exact = replace(
        arc_welder, jig=replace(arc_welder.jig, faces=tuple(replace(f, tolerance=0.0) for f in arc_welder.jig.faces))
    )
    F = known.rows(q, normal, touch_sigma(arc_welder, faces))

    left = known.error(F, faces, np.inf)

    assert np.trace(left) > 0
    assert np.trace(nominal_knowledge(exact).error(F, faces, np.inf)) == pytest.approx(0.0, abs=1e-6 * np.trace(left))


def test_robots_are_drawn_with_the_spread_of_the_priors(known, arc_welder, rng):
    robots = drawn(known, ROBOTS, rng)

    assert robots.std(axis=0) == pytest.approx(arc_welder.prior, rel=0.1)


def test_fixed_parameters_are_not_drawn(arc_welder, rng):
    known = nominal_knowledge(replace(arc_welder, fixed=frozenset({"j2.a"})))

    robots = drawn(known, 5, rng)

    place = arc_welder.robot.parameters.index("j2.a")
    assert (robots[:, place] == arc_welder.theta[place]).all()


def test_a_base_that_is_to_be_fitted_cannot_be_planned_for(arc_welder):
    with pytest.raises(InputError, match="base: fit leaves open where the base stands"):
        nominal_knowledge(replace(arc_welder, base=None))


def test_a_calibration_counts_as_information(arc_welder, known, touches):
    """After touches, what is known is what was known before and what they tell."""
    from types import SimpleNamespace

    q, normal, faces = touches
    F = known.rows(q, normal, touch_sigma(arc_welder, faces))
    scale = np.outer(known.scale, known.scale)
    calibration = SimpleNamespace(
        cell=arc_welder, theta=arc_welder.theta, estimated=known.names, index=known.kept,
        covariance=known.covariance(F) * scale,
    )  # fmt: skip

    after = knowledge_after(arc_welder, calibration)

    expected = known.precision + F.T @ F
    assert after.precision == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_tips_move_with_whitened_parameters_as_finite_differences_say(arc_welder, known, touches):
    q = touches[0][:5]
    moved = arc_welder.theta.copy()
    k, step = 3, 1e-5
    moved[known.kept[k]] += step * known.scale[k]

    tip = known.tip_rows(q)[:, :, k]

    before, after = (arc_welder.kinematics.tip(q, theta)[0] for theta in (arc_welder.theta, moved))
    assert tip == pytest.approx((after - before) / step, abs=1e-3)


@pytest.mark.parametrize("off", [1.0, 0.2, 0.02])
def test_what_is_known_of_a_robot_as_built_is_symmetric_however_nearly_parallel_its_axes_are(arc_welder, off):
    cell = replace(arc_welder, priors=Priors((10 * off, 0.035 * off), (10 * off, 0.035 * off), (3 * off, 0.017 * off)))

    known = built_knowledge(cell)

    np.testing.assert_allclose(known.precision, known.precision.T, atol=1e-15)
    np.testing.assert_allclose(
        known.precision @ known.spread, np.eye(len(known.names)), atol=1e-15 * known.spread.max()
    )
    approximate_design(np.random.default_rng(0).standard_normal((300, len(known.names))), prior=known.precision)
