"""Exact distances of many segments at once: to boxes along the axes, and to each other; coordinates come first."""

import numpy as np
from jaxtyping import Float

Points = Float[np.ndarray, "3 rows"]  # [mm]


def point_box(p: Points, lower: Float[np.ndarray, " 3"], upper: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " rows"]:
    """Distances of points from a solid box [mm], 0 inside."""
    square = np.zeros(p.shape[1])
    for x, low, high in zip(p, lower, upper, strict=True):
        square += (x - np.minimum(np.maximum(x, low), high)) ** 2
    return np.sqrt(square)


def segment_box(
    start: Points, end: Points, lower: Float[np.ndarray, " 3"], upper: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " rows"]:
    """Distances of segments from a solid box [mm], 0 where they meet.

    Along a segment the square of the distance is convex, and quadratic between the at most six places where the segment
    crosses a plane of the box. Its slope is linear there, so that the places next to the zero of the slope, one on each
    side, give the nearest point.
    """
    along = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        places = np.concatenate([(lower[:, None] - start) / along, (upper[:, None] - start) / along])
    before, behind = np.zeros(start.shape[1]), np.ones(start.shape[1])
    for place in places:
        place = np.fmax(np.fmin(place, 1.0), 0.0)  # where the segment runs along the plane, anywhere will do
        down = _slope(start, along, place, lower, upper) <= 0
        before = np.where(down, np.maximum(before, place), before)
        behind = np.where(down, behind, np.minimum(behind, place))
    fall, rise = -_slope(start, along, before, lower, upper), _slope(start, along, behind, lower, upper)
    share = np.clip(fall / np.maximum(fall + rise, 1e-300), 0.0, 1.0)
    return point_box(start + (before + share * (behind - before)) * along, lower, upper)


def _slope(
    start: Points,
    along: Points,
    place: Float[np.ndarray, " rows"],
    lower: Float[np.ndarray, " 3"],
    upper: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, " rows"]:
    """Half the slope of the squared distance from a box at a place of the segments."""
    slope = np.zeros(len(place))
    for a, d, low, high in zip(start, along, lower, upper, strict=True):
        x = a + place * d
        slope += (x - np.minimum(np.maximum(x, low), high)) * d
    return slope


def segment_segment(start: Points, end: Points, other: Points, other_end: Points) -> Float[np.ndarray, " rows"]:
    """Distances between segments [mm] (Ericson, Real-Time Collision Detection, 2005, section 5.1.9)."""
    d, e, r = end - start, other_end - other, start - other
    dd, ee = np.maximum((d * d).sum(axis=0), 1e-12), np.maximum((e * e).sum(axis=0), 1e-12)
    de = (d * e).sum(axis=0)
    dr, er = (d * r).sum(axis=0), (e * r).sum(axis=0)
    across = dd * ee - de * de
    s = np.clip(np.divide(de * er - dr * ee, across, out=np.zeros_like(dd), where=across > 1e-12 * dd * ee), 0, 1)
    t = (de * s + er) / ee
    s = np.where(t < 0, np.clip(-dr / dd, 0, 1), np.where(t > 1, np.clip((de - dr) / dd, 0, 1), s))
    gap = r + s * d - np.clip(t, 0, 1) * e
    return np.sqrt((gap * gap).sum(axis=0))
