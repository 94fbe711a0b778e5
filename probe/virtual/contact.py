"""Where a wire first meets the jig on its way: any face of it, or any side of its solid boxes.

A contact is the entry of the wire's end into the thin slab under a face. The point that matters is the point of the
wire's end that lies deepest along the normal: the end of a point, the pole of a ball, a point of the rim of a flat end
(`h = radius sqrt(1 - (n.a)^2)` before the tip, DESIGN section 3). Paths are cut in intervals of a few millimetres, in
which distances are straight lines to within micrometres; these are clipped against all slabs at once, and the contact
that comes first is then solved for to the last digit.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Wire
from identify.model.jig import Face, Jig
from identify.model.kinematics import Kinematics

INTERVAL = 8.0  # [mm] between samples; a path of 0.5 m radius bends by 16 micrometres in it
SHALLOW = 0.5  # [mm], least depth of the slab under a face
DEEP = 10.0  # [mm], how far below a face still is the inside of a jig that has no boxes
EDGE = 0.01  # [mm], an entry through the side of a slab counts that much later: the face proper owns a tie
EXACT = 1e-7  # [mm]
NO_FACE = -1


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Rectangles that conduct: the faces of a jig, then those sides of its boxes that are no faces."""

    names: tuple[str, ...]
    origin: Float[np.ndarray, "surfaces 3"]  # [mm]
    u: Float[np.ndarray, "surfaces 3"]  # unit vectors
    v: Float[np.ndarray, "surfaces 3"]
    normal: Float[np.ndarray, "surfaces 3"]
    size: Float[np.ndarray, "surfaces 2"]  # [mm]
    boxes: Float[np.ndarray, "boxes 2 3"]  # [mm], lower and upper corners
    flat: float  # [mm], radius of a flat wire end
    ball: float  # [mm], radius of a ball

    @cached_property
    def offset(self) -> Float[np.ndarray, " surfaces"]:
        """Distances of the planes from the origin of the jig frame [mm]."""
        return np.einsum("ij,ij->i", self.normal, self.origin)

    @property
    def depth(self) -> float:
        """Thickness of the slabs [mm]: the width of the wire, beyond which another face must own the contact."""
        return max(2 * self.flat, 2 * self.ball, SHALLOW)

    def gap(
        self, position: Float[np.ndarray, "*rows 3"], axis: Float[np.ndarray, "*rows 3"]
    ) -> Float[np.ndarray, "*rows surfaces"]:
        """Distances n . tip - c - h of a wire from all planes [mm]."""
        distance = position @ self.normal.T - (self.offset + self.ball)
        return distance - self.flat * np.sqrt(np.maximum(1 - (axis @ self.normal.T) ** 2, 0)) if self.flat else distance

    def place(
        self,
        surface: Int[np.ndarray, " rows"],
        position: Float[np.ndarray, "rows 3"],
        axis: Float[np.ndarray, "rows 3"],
    ) -> Float[np.ndarray, "rows 2"]:
        """Where on its rectangle, along u and v [mm], the deepest point of the wire's end lies."""
        n, u, v = self.normal[surface], self.u[surface], self.v[surface]
        along = np.einsum("ij,ij->i", n, axis)
        rim = self.flat * along / np.sqrt(np.maximum(1 - along**2, 1e-24))
        from_origin = position - self.origin[surface] + rim[:, None] * axis
        return np.stack([np.einsum("ij,ij->i", from_origin, u), np.einsum("ij,ij->i", from_origin, v)], axis=1)

    def inside(self, position: Float[np.ndarray, "rows 3"]) -> Bool[np.ndarray, " rows"]:
        """Whether a tip lies in a solid box."""
        p = position[:, None]
        within = np.all((p > self.boxes[:, 0]) & (p < self.boxes[:, 1]), axis=2)
        return np.asarray(np.any(within, axis=1))


def surfaces(jig: Jig, wire: Wire, proud: Mapping[str, float] | None = None) -> Surfaces:
    """What a wire can touch on a jig whose faces stand `proud` of their drawing [mm]."""
    drawn = _drawn(jig, wire)
    if not proud:
        return drawn
    shift = np.array([proud.get(name, 0.0) for name in drawn.names])
    return replace(drawn, origin=drawn.origin + shift[:, None] * drawn.normal)


@lru_cache(maxsize=8)
def _drawn(jig: Jig, wire: Wire) -> Surfaces:
    faces = [*jig.faces, *_sides(jig)]
    u, v, normal = (np.array([getattr(face, key) for face in faces]) for key in ("u", "v", "normal"))
    size = np.array([face.size for face in faces])
    return Surfaces(
        names=tuple(face.name for face in faces), origin=np.array([face.origin for face in faces]),
        u=u / size[:, :1], v=v / size[:, 1:], normal=normal, size=size,
        boxes=np.array([(box.lower, box.upper) for box in jig.boxes], dtype=float).reshape(-1, 2, 3),
        flat=wire.radius if wire.shape == "flat" else 0.0, ball=wire.radius if wire.shape == "ball" else 0.0,
    )  # fmt: skip


def _sides(jig: Jig) -> list[Face]:
    """Sides of the boxes that lie in the plane of no face, the table around the jig for instance."""
    planes = {(*face.normal.round(6), round(face.offset, 3)) for face in jig.faces}
    found = []
    for i, box in enumerate(jig.boxes):
        lower, edges = np.array(box.lower, dtype=float), np.diag(np.subtract(box.upper, box.lower))
        for axis in range(3):
            u, v = edges[(axis + 1) % 3], edges[(axis + 2) % 3]
            for origin, a, b in ((lower, v, u), (lower + edges[axis], u, v)):
                side = Face(f"box {i + 1}", origin, a, b)
                if (*side.normal.round(6), round(side.offset, 3)) not in planes:
                    found.append(side)
    return found


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
    kinematics: Kinematics, surface: Surfaces, paths: Paths, fraction: Float[np.ndarray, " paths"],
    shift: Float[np.ndarray, " paths"],
) -> Bool[np.ndarray, " paths"]:  # fmt: skip
    """Whether the wire touches at a fraction of each path, the contact coming `shift` [mm] before a face."""
    position, axis = paths.tips(kinematics, np.arange(len(fraction)), fraction)
    gap = surface.gap(position, axis) - shift[:, None]
    depth = surface.depth if len(surface.boxes) else max(DEEP, surface.depth)
    row, face = np.nonzero((gap <= 0) & (gap >= -depth))
    place = surface.place(face, position[row], axis[row])
    closed = surface.inside(position)
    closed[row[((place >= 0) & (place <= surface.size[face])).all(axis=1)]] = True
    return closed


def first_contact(
    kinematics: Kinematics, surface: Surfaces, paths: Paths, shift: Float[np.ndarray, " paths"], intervals: int
) -> tuple[Float[np.ndarray, " paths"], Int[np.ndarray, " paths"]]:
    """Fraction of each path at which the wire first touches (1 or more: never) and the surface that it meets.

    A path that begins in a slab has fraction 0. `shift` [mm] is how far before a face the contact closes.
    """
    count, samples = len(paths.start), intervals + 1
    row = np.repeat(np.arange(count), samples)
    position, axis = paths.tips(kinematics, row, np.tile(np.linspace(0, 1, samples), count))
    gap = surface.gap(position, axis) - np.repeat(shift, samples)[:, None]
    begin, face, enter, through = _entries(surface, position, axis, gap, samples)
    fraction = (begin % samples + enter) / intervals
    length = np.linalg.norm(position[begin + 1] - position[begin], axis=1)
    rank = fraction + np.where(through, 0.0, EDGE / np.maximum(length, EDGE) / intervals)
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
    return out, met


def _entries(
    surface: Surfaces, position: Float[np.ndarray, "rows 3"], axis: Float[np.ndarray, "rows 3"],
    gap: Float[np.ndarray, "rows surfaces"], samples: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Entries into slabs: sample before, surface, fraction of the interval, and whether through the face itself."""
    low, high = np.minimum(gap[:-1], gap[1:]), np.maximum(gap[:-1], gap[1:])
    near = (low <= 0) & (high >= -surface.depth)
    near[samples - 1 :: samples] = False  # from the end of one path to the start of the next
    begin, face = np.nonzero(near)
    ends = []
    for row in (begin, begin + 1):
        place, g = surface.place(face, position[row], axis[row]), gap[row, face][:, None]
        ends.append(np.hstack([g, -g - surface.depth, -place, place - surface.size[face]]))
    enter, through = _clip(*ends)
    found = np.isfinite(enter)
    return begin[found], face[found], enter[found], through[found]


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
    """Roots between a and b, by regula falsi with the Illinois rule; nearly straight lines need two or three steps."""
    x = b
    for _ in range(12 if len(b) else 0):
        x = np.where(fa == fb, b, (a * fb - b * fa) / np.where(fa == fb, 1.0, fb - fa))
        fx = f(x)
        if np.abs(fx).max() < EXACT:
            break
        same = fx * fb > 0
        a, fa = np.where(same, a, b), np.where(same, 0.5 * fa, fb)
        b, fb = x, fx
    return x
