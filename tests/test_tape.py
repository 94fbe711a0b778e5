"""CasADi's own virtual machine judges what NumPy makes of its programs."""

import casadi as ca
import numpy as np
import pytest

from identify.model import mapped
from identify.model.kinematics import Kinematics
from identify.model.mapped import Mapped
from identify.model.measurement import MeasurementModel, Rows
from identify.model.tape import CHUNK, Tape

a, b, c = ca.SX.sym("a"), ca.SX.sym("b"), ca.SX.sym("c", 2)
EXPRESSIONS = {
    "arithmetic": [a + b, a - b, a * b, a / b, -a, 2 * a, a**2, 1 / b, a**3, a**b],
    "functions": [ca.sin(a), ca.cos(a), ca.tan(a), ca.exp(a), ca.sqrt(b), ca.log(b), ca.fabs(a), ca.sign(a)],
    "inverse functions": [ca.asin(a / 4), ca.acos(a / 4), ca.atan(a), ca.atan2(a, b)],
    "choices": [ca.fmin(a, b), ca.fmax(a, b), ca.if_else(a < b, a, b), ca.if_else(a <= 0, b, 1)],
    "equality": [ca.if_else(a == b, 1, 2), ca.if_else(a != b, a, 0), ca.if_else(ca.logic_not(a < b), a, b)],
    "constants": [ca.SX(3), a, ca.dot(c, c)],
}  # fmt: skip


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_every_operation_is_that_of_casadi(name, rng):
    function = ca.Function("f", [a, b, c], [ca.densify(ca.vertcat(*EXPRESSIONS[name]))])
    columns = [rng.uniform(-3, 3, (60, 1)), rng.uniform(0.1, 3, (60, 1)), rng.normal(size=2)]
    columns[0][:3] = columns[1][:3]  # equal values, for the choices
    out = np.empty((60, function.numel_out(0)))

    Tape(function).play(columns, [out])

    assert Tape(function).playable
    (expected,) = Mapped(function)(*columns)  # few enough rows for CasADi's machine
    np.testing.assert_allclose(out, expected, rtol=1e-15, atol=1e-15)


def test_infinities_and_nans_travel_through_without_a_warning():
    function = ca.Function("f", [a, b], [a / b, ca.sqrt(a)])
    out = [np.empty((2, 1)), np.empty((2, 1))]

    Tape(function).play([np.array([[1.0], [-1.0]]), np.array([0.0])], out)

    np.testing.assert_array_equal(out[0][:, 0], [np.inf, -np.inf])
    np.testing.assert_array_equal(out[1][:, 0], [1.0, np.nan])


def test_a_program_with_an_operation_that_is_not_in_the_table_is_left_to_casadi(rng, monkeypatch):
    function = ca.Function("f", [a], [ca.erf(a)])
    monkeypatch.setattr(mapped, "FEWEST", 1)

    (out,) = Mapped(function)(rng.normal(size=(5, 1)))

    assert not Tape(function).playable
    assert out.shape == (5,)


def test_many_rows_give_what_casadi_gives(arc_welder, rng, monkeypatch):
    robot, m = arc_welder.robot, CHUNK + 7
    q = rng.uniform(robot.lower, robot.upper, (m, 6))
    normal = rng.normal(size=(m, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    rows = Rows(q, normal, rng.normal(size=m), np.full(m, 0.6), np.ones(m), (), np.arange(m))

    r, J = MeasurementModel(robot).linearize(arc_welder.theta, rows)
    position, R = Kinematics(robot).tip(q, arc_welder.theta)

    monkeypatch.setattr(mapped, "FEWEST", 10 * m)
    r_casadi, J_casadi = MeasurementModel(robot).linearize(arc_welder.theta, rows)
    position_casadi, R_casadi = Kinematics(robot).tip(q, arc_welder.theta)
    np.testing.assert_allclose(r, r_casadi, rtol=0, atol=1e-11)  # [mm]
    np.testing.assert_allclose(J, J_casadi, rtol=0, atol=1e-11)
    np.testing.assert_allclose(position, position_casadi, rtol=0, atol=1e-11)
    np.testing.assert_allclose(R, R_casadi, rtol=0, atol=1e-14)
