"""Orientations as SciPy has them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from identify.programs.orientation import angle_between, from_euler, from_quaternion

degrees = st.floats(-180, 180)


@given(degrees, degrees, degrees)
def test_angles_are_turns_about_z_then_y_then_x_of_the_moved_frame(rz, ry, rx):
    expected = Rotation.from_euler("ZYX", [rz, ry, rx], degrees=True).as_matrix()

    np.testing.assert_allclose(from_euler(np.array([rz, ry, rx])), expected, atol=1e-12)


@given(
    st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1), st.floats(0.9, 1.1)
)
def test_a_quaternion_that_rounding_has_left_off_its_length_is_still_its_rotation(q, length):
    unit = np.array(q) / np.linalg.norm(q)

    expected = Rotation.from_quat(unit, scalar_first=True).as_matrix()

    np.testing.assert_allclose(from_quaternion(length * unit), expected, atol=1e-12)


@given(st.tuples(degrees, degrees, degrees), st.tuples(degrees, degrees, degrees))
def test_the_angle_between_orientations_is_that_of_the_turn_from_one_to_the_other(first, second):
    a, b = (Rotation.from_euler("ZYX", angles, degrees=True) for angles in (first, second))

    angle = angle_between(a.as_matrix(), b.as_matrix())

    assert angle == pytest.approx(np.degrees((a.inv() * b).magnitude()), abs=1e-5)
