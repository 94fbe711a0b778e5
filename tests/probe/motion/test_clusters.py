"""Groups of triangles: together they are the mesh, and each is smaller than the whole."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from probe.motion.clusters import clusters


@given(st.integers(0, 2**31), st.integers(1, 40), st.integers(1, 12))
def test_every_corner_is_in_a_group_and_there_are_no_more_groups_than_asked_for(seed, count, most):
    corners = np.random.default_rng(seed).normal(size=(3 * count, 3))
    triangles = np.arange(3 * count).reshape(-1, 3)

    groups = clusters(corners, triangles, most)

    assert len(groups) == min(most, count)
    together = np.unique(np.concatenate(groups), axis=0)
    np.testing.assert_array_equal(together, np.unique(corners, axis=0))


def test_two_heaps_far_apart_are_two_groups(rng):
    heap = rng.normal(size=(30, 3))
    corners = np.concatenate([heap, heap + np.array([1000.0, 0, 0])])

    groups = clusters(corners, np.arange(60).reshape(-1, 3), 2)

    assert sorted(np.ptp(group, axis=0).max() < 10 for group in groups) == [True, True]


def test_triangles_that_lie_on_each_other_stay_together():
    assert len(clusters(np.eye(3), np.tile([0, 1, 2], (5, 1)), 4)) == 1
