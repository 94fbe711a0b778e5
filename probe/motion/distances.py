"""Exact distances of many segments at once: to boxes along the axes, and to each other; coordinates come first.

Bounds on distances, each a few operations a pair, settle nearly all pairs before a distance is computed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.joint import Capsule

Points = Float[np.ndarray, "3 rows"]  # [mm]
Corner = Float[np.ndarray, "3 *rows"]  # [mm], of one box, or of one box a row
Segments = Float[np.ndarray, "3 segments postures"]  # [mm]
Frames = Sequence[Float[np.ndarray, "postures 3 4"]]  # jig_T_link
CHUNK = 1 << 15  # pairs of segments and boxes whose bounds are computed at a time, for the cache


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes around obstacles, along the same axes."""

    axes: Float[np.ndarray, "3 3"] | None  # own_R_jig; None: those of the jig
    lower: Float[np.ndarray, "3 boxes"]  # [mm]
    upper: Float[np.ndarray, "3 boxes"]
    owner: Int[np.ndarray, " boxes"]  # the obstacle that each is around

    def seen(self, p: Segments) -> Segments:
        """Points along these axes."""
        return p if self.axes is None else np.einsum("ij,jcm->icm", self.axes, p)


def slices(rows: int, size: int) -> Iterator[slice]:
    """Rows in groups."""
    return (slice(i, min(i + size, rows)) for i in range(0, rows, size))


def placed(capsules: Sequence[Capsule], frames: Frames) -> tuple[Segments, Segments]:
    """Both ends of capsules that move with links [mm]."""
    start, end = (np.empty((3, len(capsules), len(frames[0]))) for _ in range(2))
    links = np.array([c.link for c in capsules], dtype=int)
    for link in np.unique(links).tolist():
        mine, T = np.flatnonzero(links == link).tolist(), frames[link].transpose(1, 2, 0)
        for out, ends in ((start, [capsules[i].start for i in mine]), (end, [capsules[i].end for i in mine])):
            x, y, z = np.array(ends).T[:, :, None]
            for k in range(3):
                out[k, mine] = T[k, 0] * x + T[k, 1] * y + T[k, 2] * z + T[k, 3]
    return start, end


def point_box(p: Points, lower: Corner, upper: Corner) -> Float[np.ndarray, " rows"]:
    """Distances of points from a solid box [mm], 0 inside."""
    square = np.zeros(p.shape[1])
    for x, low, high in zip(p, lower, upper, strict=True):
        square += (x - np.minimum(np.maximum(x, low), high)) ** 2
    return np.sqrt(square)


def segment_box(start: Points, end: Points, lower: Corner, upper: Corner) -> Float[np.ndarray, " rows"]:
    """Distances of segments from a solid box [mm], 0 where they meet.

    Along a segment the square of the distance is convex, and quadratic between the at most six places where the segment
    crosses a plane of the box. Its slope is linear there, so that the places next to the zero of the slope, one on each
    side, give the nearest point.
    """
    along = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        places = np.concatenate([(lower.reshape(3, -1) - start) / along, (upper.reshape(3, -1) - start) / along])
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
    start: Points, along: Points, place: Float[np.ndarray, " rows"], lower: Corner, upper: Corner
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


def segment_box_bound(
    start: Segments, end: Segments, lower: Float[np.ndarray, "3 boxes"], upper: Float[np.ndarray, "3 boxes"]
) -> Float[np.ndarray, "segments boxes postures"]:
    """Squares of lower bounds on distances of segments from boxes [mm^2]: those of the boxes around the segments."""
    square = np.zeros((start.shape[1], lower.shape[1], start.shape[2]))
    for a, b, low, high in zip(start, end, lower, upper, strict=True):
        middle, reach = (a + b)[:, None] / 2 - (low + high)[:, None] / 2, np.abs(b - a)[:, None] / 2
        gap = np.maximum(np.abs(middle) - reach - (high - low)[:, None] / 2, 0.0)
        gap *= gap
        square += gap
    return square


def near_boxes(
    start: Segments,
    end: Segments,
    lower: Float[np.ndarray, "3 boxes"],
    upper: Float[np.ndarray, "3 boxes"],
    need: Float[np.ndarray, "#segments #boxes #postures"],
) -> tuple[Int[np.ndarray, " near"], Int[np.ndarray, " near"], Int[np.ndarray, " near"]]:
    """Segment, box and posture of all that come nearer to each other than `need` [mm], which is not negative."""
    shape = start.shape[1], lower.shape[1], start.shape[2]
    need, parts = np.broadcast_to(need, shape), []
    for part in slices(shape[2], max(CHUNK // max(shape[0] * shape[1], 1), 64)):
        least = need[:, :, part]
        bound = segment_box_bound(start[:, :, part], end[:, :, part], lower, upper)
        i, k, m = np.nonzero(bound < least * least)
        parts.append((i, k, m + part.start))
    i, k, m = (np.concatenate(some) for some in zip(*parts, strict=True)) if parts else np.empty((3, 0), dtype=int)
    if not len(i):
        return i, k, m
    least = need[i, k, m]
    near = _nearer(start[:, i, m], end[:, i, m], lower[:, k], upper[:, k], least)
    return i[near], k[near], m[near]


def _nearer(
    start: Points, end: Points, lower: Points, upper: Points, need: Float[np.ndarray, " rows"]
) -> Bool[np.ndarray, " rows"]:
    """Whether segments come nearer to boxes than `need`.

    They do where an end or the middle does. They do not where the plane through the point of the box that is nearest
    to one of these three, at right angles to the line between both, is far enough from both ends: the box is behind
    it. Only the others need the distance itself.
    """
    three = np.stack([start, (start + end) / 2, end])
    foot = np.clip(three, lower, upper)
    away = three - foot
    square = (away * away).sum(axis=1)
    nearest, rows = square.argmin(axis=0), np.arange(len(need))
    near = square[nearest, rows] < need * need
    far, point = away[nearest, :, rows].T, foot[nearest, :, rows].T
    low = np.minimum((far * (start - point)).sum(axis=0), (far * (end - point)).sum(axis=0))
    open_ = np.flatnonzero(~near & (low < need * np.sqrt(square[nearest, rows])))
    some = (x[:, open_] for x in (start, end, lower, upper))
    near[open_] = segment_box(*some) < need[open_]
    return near


def near_segments(
    start: Segments,
    end: Segments,
    first: Int[np.ndarray, " pairs"],
    second: Int[np.ndarray, " pairs"],
    need: Float[np.ndarray, "#pairs #postures"],
) -> tuple[Int[np.ndarray, " near"], Int[np.ndarray, " near"]]:
    """Pair and posture of segments that come nearer to each other than `need` [mm], which is not negative."""
    middle, half = (start + end) / 2, np.sqrt(((end - start) ** 2).sum(axis=0)) / 2
    away = np.sqrt(sum((x[first] - x[second]) ** 2 for x in middle))
    p, m = np.nonzero(away - half[first] - half[second] < need)
    if not len(p):
        return p, m
    a, b = first[p], second[p]
    gap = segment_segment(start[:, a, m], end[:, a, m], start[:, b, m], end[:, b, m])
    near = gap < np.broadcast_to(need, away.shape)[p, m]
    return p[near], m[near]
