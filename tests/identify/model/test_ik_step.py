"""One damped step of inverse kinematics is the minimum of its quadratic model."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from identify.model.ik_step import LEVER, POINT, POSE, descent, solved


@given(st.integers(1, 6), st.integers(0, 2**31), st.floats(0, 10))
def test_a_damped_system_is_solved_as_by_numpy(n, seed, damping):
    rng = np.random.default_rng(seed)
    root, b = rng.standard_normal((n, n)), rng.standard_normal(n)
    A = root @ root.T + 0.1 * np.eye(n)

    x = np.array(ca.evalf(solved(ca.SX(A), ca.SX(b), ca.SX(damping)))).ravel()

    np.testing.assert_allclose(x, np.linalg.solve(A + damping * np.eye(n), b), rtol=1e-8, atol=1e-8)


@pytest.fixture
def posed(arc_welder, rng):
    q = rng.uniform(-0.3, 0.3, (4, 6)) + np.array([0.0, 0.2, -0.1, 0.0, 0.9, 0.0])  # away from singularities
    return q, *arc_welder.kinematics.tip(q, arc_welder.theta)


def test_the_cost_is_the_square_of_the_way_left(arc_welder, posed, rng):
    q, p, R = posed
    way, turn = rng.normal(0, 5, (4, 3)), rng.normal(0, 0.1, (4, 3))
    wanted = Rotation.from_rotvec(turn).as_matrix() @ R

    _, cost = descent(arc_welder.robot, POSE)(q, arc_welder.theta, p + way, wanted.reshape(4, 9), np.full((4, 1), 1.0))

    np.testing.assert_allclose(cost, (way**2).sum(axis=1) + LEVER**2 * (turn**2).sum(axis=1), rtol=1e-8)


def test_a_step_with_hardly_any_damping_leaves_a_way_of_second_order(arc_welder, posed):
    q, p, R = posed
    position, damping = p + np.array([0.2, -0.1, 0.1]), np.full((4, 1), 1e-6)

    step, _ = descent(arc_welder.robot, POSE)(q, arc_welder.theta, position, R.reshape(4, 9), damping)

    left = np.linalg.norm(arc_welder.kinematics.tip(q + step, arc_welder.theta)[0] - position, axis=1)
    assert left.max() < 0.01  # of 0.24 mm


def test_where_joints_are_left_over_the_step_is_the_shortest(arc_welder, posed):
    q, p, R = posed
    position, damping = p + np.array([0.2, -0.1, 0.1]), np.full((4, 1), 1e-6)

    step, _ = descent(arc_welder.robot, POINT)(q, arc_welder.theta, position, R.reshape(4, 9), damping)

    J = arc_welder.kinematics.pose_jacobian(q, arc_welder.theta)[2][:, :3]
    for row, jacobian in zip(step, J, strict=True):
        np.testing.assert_allclose(row, np.linalg.pinv(jacobian) @ jacobian @ row, atol=1e-9)  # nothing in the kernel
