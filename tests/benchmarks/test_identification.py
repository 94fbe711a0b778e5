"""How long an identification takes, beside SciPy on the same problem.

Run with pytest tests/benchmarks/test_identification.py --benchmark-only.
"""

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from cells import cell_of
from measured import poses_over_jig, table_2, touches_at

from identify.estimation.calibrate import calibrate
from identify.estimation.least_squares import LeastSquares, Objective
from identify.estimation.problem import Problem
from identify.estimation.selection import with_errors
from identify.model.cell import Wire
from identify.model.identifiability import structure
from identify.model.joint_error_models import ERROR_MODELS
from identify.model.measurement import MeasurementModel, rows


@pytest.fixture(scope="module")
def touches(arc_welder):
    rng = np.random.default_rng(0)
    return touches_at(arc_welder, table_2(arc_welder), poses_over_jig(arc_welder, 100, rng), rng)


def problem(cell, touches):
    """The residual and its Jacobian, as any solver would want them."""
    model, found, kept = MeasurementModel(cell.robot), rows(cell.wire, [touches]), list(structure(cell).kept)

    def linearize(x):
        theta = cell.theta.copy()
        theta[kept] += x
        r, J = model.linearize(theta, found)
        return r / 0.05, J[:, kept] / 0.05

    return linearize, cell.scale[kept]


def built(cell, touches):
    """Our solver for it."""
    linearize, prior = problem(cell, touches)
    objective = Objective(lambda x: [(slice(None), *linearize(x))], prior, np.ones(len(touches)))
    return LeastSquares(objective, np.zeros(25))


def test_solve_with_ipopt(benchmark, arc_welder, touches):
    solver, start = built(arc_welder, touches), np.zeros(25)

    solution = benchmark(lambda: solver.solve(start))

    assert solution.converged


def test_build(benchmark, arc_welder, touches):
    benchmark(lambda: built(arc_welder, touches))


@pytest.mark.parametrize("jacobian", ["2-point", "ours"])
def test_solve_with_scipy(benchmark, arc_welder, touches, jacobian):
    linearize, prior = problem(arc_welder, touches)
    jac = (lambda x: linearize(x)[1]) if jacobian == "ours" else jacobian

    found = benchmark(
        lambda: scipy.optimize.least_squares(lambda x: linearize(x)[0], np.zeros(25), jac=jac, x_scale=prior)
    )

    assert found.success


@pytest.mark.parametrize("count", [1_000, 10_000, 100_000])
def test_touches_cost_in_proportion_to_their_number(benchmark, arc_welder, count):
    rng = np.random.default_rng(0)
    many = touches_at(arc_welder, table_2(arc_welder), poses_over_jig(arc_welder, count, rng), rng)

    found = benchmark.pedantic(lambda: calibrate(arc_welder, many, folds=0, errors="cell"), rounds=1)

    assert found.scatter == pytest.approx(1.0, abs=0.1)


@pytest.fixture(scope="module")
def everything():
    """An arm of seven axes with all joint errors, and where it touches."""
    cell = with_errors(replace(cell_of("arm7"), wire=Wire(0.0, "point")), tuple(ERROR_MODELS))
    return cell, np.random.default_rng(0).uniform(cell.robot.lower, cell.robot.upper, (4000, 7))


def posed(cell, q, eliminate):
    """Touches from both sides at many temperatures, by a robot a little off."""
    rng = np.random.default_rng(0)
    touches = replace(
        touches_at(cell, cell.theta + 0.01 * cell.scale, q, rng),
        approach=q - 0.1 * rng.choice([-1, 1], q.shape),
        temperature=rng.uniform(10, 30, len(q)),
    )
    return Problem.pose(cell, rows(cell.wire, [touches]), "linear", True, eliminate)


@pytest.mark.parametrize("count", [1000, 2000, 4000])
def test_joint_errors_cost_in_proportion_to_the_touches(benchmark, everything, count):
    cell, q = everything
    problem = posed(cell, q[:count], eliminate=True)

    found = benchmark(lambda: problem.solve(np.zeros(problem.size), 1 / problem.rows.sigma, "linear"))

    assert found.converged
    assert problem.size > 70


def test_more_than_a_hundred_parameters_from_a_thousand_touches(benchmark, everything):
    cell, q = everything
    problem = posed(cell, q[:1000], eliminate=False)

    found = benchmark(lambda: problem.solve(np.zeros(problem.size), 1 / problem.rows.sigma, "linear"))

    assert found.converged
    assert problem.size >= 100


@pytest.mark.parametrize("parameters", [50, 100, 200])
def test_solve_time_grows_no_worse_than_with_the_cube_of_the_parameters(benchmark, parameters):
    """The normal equations of 1000 touches, as Ipopt's steps need them."""
    rng = np.random.default_rng(0)
    A, b = rng.standard_normal((1000, parameters)), rng.standard_normal(1000)
    objective = Objective(lambda x: [(slice(None), A @ x - b, A)], np.ones(parameters), np.ones(1000))
    solver = LeastSquares(objective, np.zeros(parameters))

    assert benchmark(lambda: solver.solve(np.zeros(parameters))).converged
