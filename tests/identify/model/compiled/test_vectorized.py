"""CasADi's own virtual machine judges what is made of its programs for columns of numbers."""

import casadi as ca
import numpy as np
import pytest
from cells import cell_of

from identify.estimation.selection import with_errors
from identify.model.compiled import batch as mapped
from identify.model.compiled.batch import BLOCKS, FEWEST, Mapped
from identify.model.compiled.vectorized import columns
from identify.model.ik_step import AXIS, POSE, descent
from identify.model.joint_error_models import ERROR_MODELS
from identify.model.kinematics import Kinematics
from identify.model.measurement import MeasurementModel

a, b, c = ca.SX.sym("a"), ca.SX.sym("b"), ca.SX.sym("c", 2)
EXPRESSIONS = {
    "arithmetic": [a + b, a - b, a * b, a / b, -a, 2 * a, a**2, 1 / b, a**3, a**b, a / 3, a + a, a * a, a - 2],
    "functions": [ca.sin(a), ca.cos(a), ca.tan(a), ca.exp(a), ca.sqrt(b), ca.log(b), ca.fabs(a), ca.sign(a)],
    "inverse functions": [ca.asin(a / 4), ca.acos(a / 4), ca.atan(a), ca.atan2(a, b)],
    "other functions": [ca.tanh(a), ca.erf(a), ca.floor(a), ca.fmod(a, b), ca.hypot(a, b), ca.copysign(b, a)],
    "choices": [ca.fmin(a, b), ca.fmax(a, b), ca.if_else(a < b, a, b), ca.if_else(a <= 0, b, 1)],
    "equality": [ca.if_else(a == b, 1, 2), ca.if_else(a != b, a, 0), ca.if_else(ca.logic_not(a < b), a, b)],
    "constants": [ca.SX(3), ca.SX(0), a, ca.dot(c, c), c[0]],
    "infinities and what is no number": [a / (a - a), ca.sqrt(a), ca.log(a), ca.asin(a)],
}


@pytest.fixture(autouse=True)
def worth_it_from_the_first_row(monkeypatch):
    monkeypatch.setattr(mapped, "WORTH", 0)


def walked(function, *arguments):
    """What CasADi's virtual machine makes of every row."""
    alone = Mapped(function)
    return [alone(*(x if x.ndim < 2 else x[[i]] for x in arguments)) for i in range(len(arguments[0]))]


def in_blocks(function, *arguments):
    """What the functions of whole columns make of all rows, however many there are."""
    together = Mapped(function)
    found = together(*arguments)
    assert together._blocks or len(arguments[0]) < FEWEST
    assert None not in together._blocks.values()
    return found


def check(function, *arguments):
    for column, of_rows in zip(
        in_blocks(function, *arguments), zip(*walked(function, *arguments), strict=True), strict=True
    ):
        np.testing.assert_array_equal(column, np.concatenate(of_rows))


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_every_operation_is_that_of_casadi_to_the_last_digit(name, rng):
    function = ca.Function("f", [a, b, c], [ca.densify(ca.vertcat(*EXPRESSIONS[name]))])
    left, right = (rng.uniform(-3, 3, (sum(BLOCKS), 1)), rng.uniform(0.1, 3, (sum(BLOCKS), 1)))
    left[:3] = right[:3]  # equal values, for the choices

    check(function, left, right, rng.normal(size=2))


@pytest.mark.parametrize("robot", ["arc-welder", "arm7", "scara"])
@pytest.mark.parametrize("errors", [(), tuple(ERROR_MODELS)])
def test_robots_are_where_casadi_puts_them_to_the_last_digit(robot, errors, rng):
    cell = with_errors(cell_of(robot), errors)
    m, joints = BLOCKS[-1] + 7, len(cell.robot.joints)
    theta = cell.theta + 0.01 * cell.scale * rng.normal(size=len(cell.theta))
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (m, joints))
    kinematics, model = Kinematics(cell.robot), MeasurementModel(cell.robot)
    conditions = [rng.uniform(-1, 1, (m, joints + 2))] if errors else []

    for one in (kinematics.tip, kinematics.tip_jacobian, kinematics.pose_jacobian, kinematics.flange):
        check(one.function, q, theta)
    check(
        model._compiled("flat").function,
        q,
        theta,
        *rng.normal(size=(1, m, 3)),
        rng.normal(size=(m, 1)),
        np.ones((m, 1)),
        *conditions,
    )
    for rows in (POSE, AXIS):
        wanted = rng.normal(size=(m, 9))
        check(descent(cell.robot, rows).function, q, theta, rng.normal(size=(m, 3)), wanted, np.full((m, 1), 0.1))


def test_a_program_that_calls_another_is_left_to_casadi(rng):
    inner = ca.Function("g", [a], [ca.sin(a)], {"never_inline": True})
    function = ca.Function("f", [a], [inner(a) + 1])
    x = rng.normal(size=(5000, 1))

    (found,) = Mapped(function)(x)

    assert columns(function, [False], 4) is None
    np.testing.assert_array_equal(found, np.sin(x[:, 0]) + 1)
