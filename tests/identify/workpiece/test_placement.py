"""Rotations, the grid of starts, and residuals of a placed body."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from workpieces import SIGMA, SPREAD, hidden, touched, touches_of

from identify.workpiece.placement import Placement, grid, rotation_of

THREE_TWO_ONE = ["top"] * 3 + ["front"] * 2 + ["right"]


@given(st.lists(st.floats(-4, 4), min_size=3, max_size=3))
def test_rotations_of_rotation_vectors_are_those_of_scipy(v):
    np.testing.assert_allclose(rotation_of(np.array(v)), Rotation.from_rotvec(v).as_matrix(), atol=1e-12)


def test_the_rotations_to_start_from_leave_none_far_away():
    R = grid()
    some = Rotation.random(300, rng=np.random.default_rng(1)).as_matrix()

    nearest = np.arccos((np.einsum("sij,gij->sg", some, R).max(axis=1) - 1) / 2)

    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    assert np.degrees(nearest.max()) < 40


def test_residuals_change_with_moves_as_their_jacobian_says(found, box, rng):
    from identify.workpiece.localization import _contacts

    truth = hidden(found, rng)
    q = touched(found, box, truth, THREE_TWO_ONE, SPREAD, rng)
    contacts = _contacts(found, touches_of(box, THREE_TWO_ONE, q, SIGMA))
    at = Placement(truth[:3, :3], truth[:3, 3])

    J = at.residual(contacts)[1]

    steps = 1e-6 * np.eye(6)
    ahead, behind = (np.array([at.moved(s * e).residual(contacts)[0] for e in steps]) for s in (1, -1))
    np.testing.assert_allclose(J, (ahead - behind).T / 2e-6, atol=1e-4)
