"""Distances of segments from boxes and from each other, by other methods."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from probe.motion.distances import point_box, segment_box, segment_segment

LOWER, UPPER = np.array([-2.0, -1, -3]), np.array([1.0, 3, -1])
coordinate = st.sampled_from([-3.0, -2.0, 0.0, 1.0, 3.0]) | st.floats(-6, 6)
points = arrays(float, (3, 8), elements=coordinate)
ALONG = np.linspace(0, 1, 401)[:, None, None]


def away(p: np.ndarray) -> np.ndarray:
    """Distances of points (..., 3, rows) from the box."""
    gap = np.maximum(np.maximum(LOWER[:, None] - p, p - UPPER[:, None]), 0)
    return np.linalg.norm(gap, axis=-2)


@given(points)
def test_a_point_is_as_far_from_a_box_as_its_coordinates_lie_beyond(p):
    np.testing.assert_allclose(point_box(p, LOWER, UPPER), away(p), atol=1e-12)


@given(points, points)
def test_a_segment_is_as_far_from_a_box_as_its_nearest_point(a, b):
    sampled = away(a + ALONG * (b - a)).min(axis=0)
    spacing = np.linalg.norm(b - a, axis=0) / 400

    d = segment_box(a, b, LOWER, UPPER)

    assert (d <= sampled + 1e-9).all()
    assert (d >= sampled - spacing).all()


@given(points, points, points, points)
def test_segments_are_as_far_apart_as_their_nearest_points(a, b, c, e):
    first, second = a + ALONG[::10] * (b - a), c + ALONG[::10] * (e - c)
    sampled = np.linalg.norm(first[:, None] - second[None], axis=2).min(axis=(0, 1))
    spacing = (np.linalg.norm(b - a, axis=0) + np.linalg.norm(e - c, axis=0)) / 40

    d = segment_segment(a, b, c, e)

    assert (d <= sampled + 1e-6).all()
    assert (d >= sampled - spacing).all()
