"""Where a wire first meets the jig on its way: any face of it, or any side of its solid boxes.

A contact is the entry of the wire's end into the thin slab under a face. Paths are cut in intervals of a few
millimetres, in which distances are straight lines to within micrometres; these are clipped against all slabs at once,
and the contact that comes first is then solved for to the last digit.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.kinematics import Kinematics
from identify.model.shape import entries
from probe.virtual.surfaces import Surfaces

INTERVAL = 8.0  # [mm] between samples; a path of 0.5 m radius bends by 16 micrometres in it
EDGE = 0.01  # [mm], an entry through the side of a slab counts that much later: the face proper owns a tie
BORNE = 1.0  # [mm], as much later counts a shape: a face that lies on a mesh owns the contact
EXACT = 1e-6  # [mm]
NO_FACE = -1


@dataclass(frozen=True, eq=False)
class Paths:
    """Straight lines in joint space, with the play of the gears: the arm stays until the play is taken up."""

    start: Float[np.ndarray, "paths joints"]  # [rad] or [mm]
    end: Float[np.ndarray, "paths joints"]
    theta: Float[np.ndarray, "..."]  # one vector for all paths, or one a path
    held: Float[np.ndarray, "paths joints"] | None = None  # where the arm stood before, behind the gears
    play: Float[np.ndarray, " joints"] | float = 0.0  # half of the backlash

    def at(
        self, path: Int[np.ndarray, " rows"], fraction: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, "rows joints"]:
        """True joints at fractions of paths."""
        q = self.start[path] + fraction[:, None] * (self.end[path] - self.start[path])
        return q if self.held is None else np.clip(self.held[path], q - self.play, q + self.play)

    def tips(
        self, kinematics: Kinematics, path: Int[np.ndarray, " rows"], fraction: Float[np.ndarray, " rows"]
    ) -> tuple[Float[np.ndarray, "rows 3"], Float[np.ndarray, "rows 3"]]:
        """Tip positions [mm] and wire axes at fractions of paths."""
        rows = len(path)
        padded = np.resize(path, _padded(rows))
        theta = self.theta if self.theta.ndim == 1 else self.theta[padded]
        position, rotation = kinematics.tip(self.at(padded, np.resize(fraction, len(padded))), theta)
        return position[:rows], rotation[:rows, :, 2]


def _padded(rows: int) -> int:
    """A size not below `rows`, of which there are few: each is compiled once."""
    return 1 << (rows - 1).bit_length() if rows <= 128 else -(-rows // 128) * 128


def touching(
    kinematics: Kinematics,
    surface: Surfaces,
    paths: Paths,
    fraction: Float[np.ndarray, " paths"],
    shift: Float[np.ndarray, " paths"],
) -> Bool[np.ndarray, " paths"]:
    """Whether the wire touches at a fraction of each path, the contact coming `shift` [mm] before a face."""
    position, axis = paths.tips(kinematics, np.arange(len(fraction)), fraction)
    return surface.closed(position, axis, surface.gap(position, axis) - shift[:, None])


def first_contact(
    kinematics: Kinematics, surface: Surfaces, paths: Paths, shift: Float[np.ndarray, " paths"], intervals: int
) -> tuple[Float[np.ndarray, " paths"], Int[np.ndarray, " paths"], Bool[np.ndarray, " paths"]]:
    """Fraction of each path at which the wire first touches (1 or more: never), the surface, and who touches at 0.

    `shift` [mm] is how far before a face the contact closes.
    """
    count, samples = len(paths.start), intervals + 1
    row = np.repeat(np.arange(count), samples)
    position, axis = paths.tips(kinematics, row, np.tile(np.linspace(0, 1, samples), count))
    gap = surface.gap(position, axis) - np.repeat(shift, samples)[:, None]
    begins = slice(None, None, samples)
    closed = surface.closed(position[begins], axis[begins], gap[begins])
    begin, face, enter, through = _entries(surface, position, axis, gap, samples)
    fraction = (begin % samples + enter) / intervals
    length = np.linalg.norm(position[begin + 1] - position[begin], axis=1)
    late = np.where(through, 0.0, np.where(face < len(surface.origin), EDGE, BORNE))
    rank = fraction + late / np.maximum(length, EDGE) / intervals
    order = np.lexsort((rank, begin // samples))
    path, first = np.unique(begin[order] // samples, return_index=True)
    first = order[first]
    out, met = np.full(count, np.inf), np.full(count, NO_FACE)
    out[path], met[path] = fraction[first], face[first]
    exact = through[first]
    path, start, face = path[exact], begin[first][exact], face[first][exact]

    def gap_at(fraction: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
        return surface.gap(*paths.tips(kinematics, path, fraction))[np.arange(len(path)), face] - shift[path]

    low = start % samples / intervals
    out[path] = _root(gap_at, low, low + 1 / intervals, gap[start, face], gap[start + 1, face])
    return out, met, closed


def _entries(
    surface: Surfaces,
    position: Float[np.ndarray, "rows 3"],
    axis: Float[np.ndarray, "rows 3"],
    gap: Float[np.ndarray, "rows surfaces"],
    samples: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Entries into slabs and shapes: sample before, surface, fraction of the interval, whether through the face."""
    low, high = np.minimum(gap[:-1], gap[1:]), np.maximum(gap[:-1], gap[1:])
    near = (low <= 0) & (high >= -surface.depth)
    near[samples - 1 :: samples] = False  # from the end of one path to the start of the next
    begin, face = np.nonzero(near)
    ends = []
    for row in (begin, begin + 1):
        place, g = surface.place(face, position[row], axis[row]), gap[row, face][:, None]
        ends.append(np.hstack([g, -g - surface.depth, -place, place - surface.size[face]]))
    enter, through = _clip(*ends)
    inside = np.isfinite(enter)
    found = [(begin[inside], face[inside], enter[inside], through[inside])]
    for k, shape in enumerate(surface.shapes):
        enter = entries(shape, position[:-1], np.diff(position, axis=0))
        enter[samples - 1 :: samples] = np.inf
        begin = np.flatnonzero(np.isfinite(enter))
        number = np.full(len(begin), len(surface.origin) + k)
        found.append((begin, number, enter[begin], np.zeros(len(begin), dtype=bool)))
    begin, face, enter, through = (np.concatenate(column) for column in zip(*found, strict=True))
    return begin, face, enter, through


def _clip(
    c0: Float[np.ndarray, "rows 6"], c1: Float[np.ndarray, "rows 6"]
) -> tuple[Float[np.ndarray, " rows"], Bool[np.ndarray, " rows"]]:
    """Fraction of an interval at which no constraint is above 0 (inf: never), and whether the first one came last."""
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = c0 / (c0 - c1)
    enter = np.where(c0 > 0, np.where(c1 > 0, np.inf, crossing), 0.0)
    leave = np.where((c0 <= 0) & (c1 > 0), crossing, 1.0).min(axis=1)
    last = enter.max(axis=1)
    return np.where(last <= leave, last, np.inf), (enter[:, 0] >= last) & (c0[:, 0] > 0)


def _root(
    f: Callable[[np.ndarray], np.ndarray], a: np.ndarray, b: np.ndarray, fa: np.ndarray, fb: np.ndarray
) -> Float[np.ndarray, " rows"]:
    """Roots between a and b: a straight line, then inverse parabolas (Brent 1973), or halves where these leave the way.

    Nearly straight lines need two evaluations.
    """
    if not len(b):
        return b
    x = (a * fb - b * fa) / (fb - fa)
    for _ in range(40):
        fx = f(x)
        exact = np.abs(fx) < EXACT
        if exact.all():
            break
        with np.errstate(divide="ignore", invalid="ignore"):
            parabola = a * fb * fx / ((fa - fb) * (fa - fx)) + b * fa * fx / ((fb - fa) * (fb - fx))
            parabola += x * fa * fb / ((fx - fa) * (fx - fb))
        a, fa = np.where(fx > 0, x, a), np.where(fx > 0, fx, fa)
        b, fb = np.where(fx > 0, b, x), np.where(fx > 0, fb, fx)
        x = np.where(exact, x, np.where((parabola > a) & (parabola < b), parabola, (a + b) / 2))
    return x
