"""A least squares problem: its covariance is that of the normal equations, and what is left out is the prior's."""

import numpy as np
import pytest
from measured import poses_over_jig, table_2, touches_at

from identify.estimation.problem import Problem, with_face_scatter
from identify.model.files import InputError
from identify.model.measurement import rows


@pytest.fixture(scope="module")
def measured(arc_welder):
    rng = np.random.default_rng(3)
    touches = touches_at(arc_welder, table_2(arc_welder), poses_over_jig(arc_welder, 60, rng), rng)
    return rows(arc_welder.wire, [touches])


@pytest.fixture(scope="module", params=[True, False], ids=["single parameters", "all unknowns"])
def problem(request, arc_welder, measured):
    return Problem.pose(arc_welder, measured, "linear", True, eliminate=request.param)


def test_the_jacobian_is_the_slope_of_the_residual(problem, rng):
    x = 0.1 * rng.standard_normal(problem.size)
    way = rng.standard_normal(problem.size)
    ((_, _, J),) = problem.linearized(x)

    step = 1e-5
    slope = (problem.residual(x + step * way) - problem.residual(x - step * way)) / (2 * step)

    np.testing.assert_allclose(J @ way, slope, atol=1e-5 * np.abs(slope).max())


def test_the_covariance_is_the_inverse_of_rows_and_priors(problem):
    x, weight = np.zeros(problem.size), 1 / problem.rows.sigma
    ((_, _, J),) = problem.linearized(x)
    W = J * weight[:, None]

    expected = np.linalg.inv(W.T @ W + np.diag(1 / problem.prior**2))

    C = problem.covariance(x, weight)
    unit = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(C / np.outer(unit, unit), expected / np.outer(unit, unit), atol=1e-4)


def test_nothing_is_known_of_directions_left_out_but_their_priors(problem):
    C = problem.of_unknowns(np.zeros((problem.size, problem.size)))  # the rest is known exactly

    value = np.linalg.eigvalsh(C)
    left_out = len(problem.unknowns) - problem.size
    np.testing.assert_allclose(np.sort(value)[len(value) - left_out :], 1.0, atol=1e-9)
    np.testing.assert_allclose(np.sort(value)[: len(value) - left_out], 0.0, atol=1e-9)


def test_a_robot_has_the_coordinates_that_lead_back_to_it(problem, rng):
    x = 0.1 * rng.standard_normal(problem.size)
    shared = len(problem.unknowns) - len(problem.unknowns.parameters)
    x = problem.basis.T @ np.append((problem.basis @ x)[: len(problem.unknowns.parameters)], np.zeros(shared))

    np.testing.assert_allclose(problem.coordinates(problem.theta(x)), x, atol=1e-9)


def test_the_minimum_is_stationary_and_its_neighbourhood_is_not_better(problem, rng):
    weight = 1 / problem.rows.sigma

    solution = problem.solve(np.zeros(problem.size), weight, "linear")

    def cost(x):
        held = np.isfinite(problem.prior)
        return ((problem.residual(x) * weight) ** 2).sum() + ((x / problem.prior)[held] ** 2).sum()

    assert problem.is_stationary(solution.x, weight)
    best = cost(solution.x)
    assert all(cost(solution.x + 1e-3 * way) > best for way in rng.standard_normal((10, problem.size)))


def test_rows_scatter_by_sensor_and_face_together(arc_welder, measured):
    rows_of_faces = with_face_scatter(arc_welder, measured)

    for name, before, after in zip(measured.face, measured.sigma, rows_of_faces.sigma, strict=True):
        tolerance = arc_welder.jig.by_name[name].tolerance if name else 0.0
        assert after**2 == pytest.approx(before**2 + tolerance**2)


def test_a_loss_that_is_none_is_refused_with_those_there_are(arc_welder, measured):
    with pytest.raises(InputError, match="loss 'huge' is not known; choose one of huber, linear"):
        Problem.pose(arc_welder, measured, "huge", True)
