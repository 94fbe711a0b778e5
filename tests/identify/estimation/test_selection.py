"""Joint errors chosen by the data: what is there is found, what is not is not, and held-out errors say why."""

from dataclasses import replace

import numpy as np
import pytest
from cells import cell_of
from measured import touches_at

from identify.estimation.calibrate import calibrate
from identify.estimation.problem import Problem
from identify.estimation.selection import select, with_errors
from identify.model.cell import Wire
from identify.model.identifiability import structure
from identify.model.joint_error_models import ERROR_MODELS, SIZES
from identify.model.measurement import measurement_model, rows

TOUCHES, SIGMA = 300, 0.05


@pytest.fixture(scope="module")
def cell():
    return replace(cell_of("irb120"), wire=Wire(0.0, "point"))


def made(cell, errors, rng, sizes=(1.0, 2.0)):
    """Touches all over the reach of a robot that truly has these errors, from all sides and at many temperatures."""
    true = with_errors(cell, errors)
    theta, robot = true.theta.copy(), true.robot
    theta += np.where(np.arange(len(theta)) < 6, 0.3, 0.05) * true.scale * rng.standard_normal(len(theta))
    theta[6 + 5 * len(robot.joints) : -6] = 0.0
    kept = structure(true).kept
    for name, key, _ in robot.error_parameters:
        i, usual = robot.parameters.index(name), SIZES[key].usual * SIZES[key].inside
        theta[i] = usual * rng.choice([-1, 1]) * rng.uniform(*sizes) if i in kept else 0.0
    q = rng.uniform(robot.lower, robot.upper, (TOUCHES, len(robot.joints)))
    touches = replace(
        touches_at(true, theta, q, rng, SIGMA),
        approach=q - 0.05 * rng.choice([-1, 1], q.shape),
        temperature=rng.uniform(10, 30, TOUCHES),
    )
    where = measurement_model(robot).residual(
        theta, rows(true.wire, [replace(touches, offset=np.zeros(TOUCHES))], robot)
    )
    return true, theta, replace(touches, offset=where + SIGMA * rng.standard_normal(TOUCHES))


def chosen(cell, touches, rng):
    problem = Problem.pose(cell, rows(cell.wire, [touches], cell.robot), "huber", True)
    return select(problem, rng)


@pytest.mark.parametrize("name", ERROR_MODELS)
def test_an_effect_that_is_there_is_chosen_alone(name, cell, rng):
    _, _, touches = made(cell, (name,), rng)

    found = chosen(cell, touches, rng)

    assert found.errors == (name,)
    first = found.terms[0]
    assert (first.name, first.kept) == (name, True)
    assert first.gain_mm > 2 * first.standard_error_mm


def test_all_effects_together_are_all_chosen(cell, rng):
    _, _, touches = made(cell, tuple(ERROR_MODELS), rng, sizes=(2.0, 3.0))

    assert set(chosen(cell, touches, rng).errors) == set(ERROR_MODELS)


def test_nothing_is_chosen_where_nothing_is_there(cell):
    found = [chosen(cell, made(cell, (), rng)[2], rng).errors for rng in map(np.random.default_rng, range(8))]

    assert found == [()] * 8


def test_values_lie_inside_their_intervals(cell, rng):
    true, theta, touches = made(cell, ("harmonics", "compliance"), rng, sizes=(0.5, 1.5))

    found = calibrate(cell, touches, parameters="identifiable", errors="auto", folds=0)

    assert found.cell.robot.errors == ("harmonics", "compliance")
    names = [name for name, _, _ in true.robot.error_parameters if name in found.estimated]
    index = [true.robot.parameters.index(name) for name in names]
    off = theta[index] - found.theta[index]
    assert (np.abs(off) < 1.96 * found.sigma[index]).mean() >= 0.9
    assert len(names) > 30


def test_touches_that_are_wrong_do_not_call_for_a_model(cell, rng):
    _, _, touches = made(cell, (), rng)
    offset = touches.offset.copy()
    offset[::30] += 3.0

    assert chosen(cell, replace(touches, offset=offset), rng).errors == ()


def test_models_that_no_touch_can_show_are_not_offered(cell, rng):
    _, _, touches = made(cell, (), rng)

    found = chosen(cell, replace(touches, temperature=np.full(TOUCHES, np.nan)), rng)

    assert "thermal" not in {term.name for term in found.terms}


def test_models_of_the_cell_file_stay(cell, rng):
    with_gear = with_errors(cell, ("gear",))
    _, _, touches = made(cell, (), rng)

    found = calibrate(with_gear, touches, parameters="identifiable", errors="auto", folds=0)

    assert found.cell.robot.errors == ("gear",)
