"""Transforms against SciPy, and the laws that rigid motions obey."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from identify.model.frames import euler, inverse, nearest_rotation, pose, rotation, transform

near = st.sampled_from([0.0, 1e-13, 1e-11, 1e-9, 1e-7])
angle = st.builds(sum, st.tuples(st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi]), near)) | st.floats(-10, 10)
poses = st.tuples(arrays(float, 3, elements=st.floats(-5000, 5000)), arrays(float, 3, elements=angle)).map(np.hstack)


def test_rotations_are_those_of_scipy(rng):
    angles = rng.uniform(-7, 7, (50, 3))

    R = rotation(*angles.T)

    np.testing.assert_allclose(R, Rotation.from_euler("ZYX", angles).as_matrix(), atol=1e-14)


@given(poses)
def test_a_pose_read_back_from_its_transform_is_the_same_place_and_attitude(x):
    T = transform(x)

    again = pose(T)

    np.testing.assert_allclose(transform(again), T, rtol=0, atol=5e-12)
    assert abs(again[4]) <= np.pi / 2 + 1e-15


@pytest.mark.parametrize("ry", [np.pi / 2, -np.pi / 2])
def test_at_ninety_degrees_of_pitch_rz_carries_the_whole_turn(ry):
    R = rotation(0.7, ry, 0.2)

    rz, pitch, rx = euler(R)

    assert pitch == pytest.approx(ry)
    assert rx == 0
    assert rz == pytest.approx(0.7 - np.sign(ry) * 0.2)


def test_angles_within_their_range_come_back_as_they_were(rng):
    angles = rng.uniform([-3.1, -1.5, -3.1], [3.1, 1.5, 3.1], (200, 3))

    np.testing.assert_allclose(euler(rotation(*angles.T)), angles, atol=1e-12)


@given(poses)
def test_the_inverse_undoes(x):
    T = transform(x)

    np.testing.assert_allclose(T @ inverse(T), np.eye(4), atol=1e-10)
    np.testing.assert_allclose(inverse(T), np.linalg.inv(T), atol=1e-9)


def test_stacks_are_treated_row_by_row(rng):
    x = rng.normal(size=(4, 5, 6))

    T = transform(x)

    assert T.shape == (4, 5, 4, 4)
    np.testing.assert_array_equal(T[2, 3], transform(x[2, 3]))
    np.testing.assert_array_equal(inverse(T)[2, 3], inverse(T[2, 3]))
    np.testing.assert_array_equal(pose(T)[2, 3], pose(T[2, 3]))


def test_the_nearest_rotation_is_the_one_scipy_aligns_with(rng):
    for _ in range(20):
        M = rng.normal(size=(3, 3))  # half of them are nearer to a reflection

        R = nearest_rotation(M)

        aligned, _ = Rotation.align_vectors(M.T, np.eye(3))  # minimises |M - R| too (Kabsch)
        np.testing.assert_allclose(R, aligned.as_matrix(), atol=1e-9)
        assert np.linalg.det(R) == pytest.approx(1)


def test_a_rotation_is_its_own_nearest():
    R = rotation(0.3, -1.2, 2.5)

    np.testing.assert_allclose(nearest_rotation(R), R, atol=1e-14)
