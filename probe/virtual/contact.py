"""Where a wire first meets the jig on its way: any face of it, or any side of its solid boxes.

A contact is the entry of the wire's end into the thin slab under a face. The point that matters is the point of the
wire's end that lies deepest along the normal: the end of a point, the pole of a ball, a point of the rim of a flat end
(`h = radius sqrt(1 - (n.a)^2)` before the tip, DESIGN section 3). Paths are cut in intervals of a few millimetres, in
which distances are straight lines to within micrometres; these are clipped against all slabs at once, and the contact
that comes first is then solved for to the last digit.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Wire
from identify.model.jig import Face, Jig
from identify.model.kinematics import Kinematics

INTERVAL = 8.0  # [mm] between samples; a path of 0.5 m radius bends by 16 micrometres in it
SHALLOW = 0.5  # [mm], least depth of the slab under a face
DEEP = 10.0  # [mm], how far below a face still is the inside of a jig that has no boxes
EDGE = 0.01  # [mm], an entry through the side of a slab counts that much later: the face proper owns a tie
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

    @property
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


def surfaces(jig: Jig, wire: Wire, proud: dict[str, float] | None = None) -> Surfaces:
    """What a wire can touch on a jig whose faces stand `proud` of their drawing [mm]."""
    faces = [*jig.faces, *_sides(jig)]
    shift = np.array([(proud or {}).get(face.name, 0.0) for face in faces])
    u, v, normal = (np.array([getattr(face, key) for face in faces]) for key in ("u", "v", "normal"))
    size = np.array([face.size for face in faces])
    return Surfaces(
        names=tuple(face.name for face in faces),
        origin=np.array([face.origin for face in faces]) + shift[:, None] * normal,
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
        padded = np.resize(path, 1 << (rows - 1).bit_length()) if rows else path  # few sizes, so few compiled maps
        theta = self.theta if self.theta.ndim == 1 else self.theta[padded]
        position, rotation = kinematics.tip(self.at(padded, np.resize(fraction, len(padded))), theta)
        return position[:rows], rotation[:rows, :, 2]


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
    count = len(paths.start)
    fractions = np.linspace(0, 1, intervals + 1)
    row = np.repeat(np.arange(count), intervals + 1)
    position, axis = paths.tips(kinematics, row, np.tile(fractions, count))
    gap = surface.gap(position, axis).reshape(count, intervals + 1, -1) - shift[:, None, None]
    low, high = np.minimum(gap[:, :-1], gap[:, 1:]), np.maximum(gap[:, :-1], gap[:, 1:])
    path, k, face = np.nonzero((low <= 0) & (high >= -surface.depth))
    sample = path * (intervals + 1) + k
    ends = [_constraints(surface, gap, path, k + i, face, position[sample + i], axis[sample + i]) for i in (0, 1)]
    enter, through_face = _clip(*ends)
    hit = np.isfinite(enter)
    path, face, through_face, begin = path[hit], face[hit], through_face[hit], k[hit]
    fraction = (begin + enter[hit]) / intervals
    length = np.linalg.norm(position[sample[hit] + 1] - position[sample[hit]], axis=1)
    rank = fraction + np.where(through_face, 0.0, EDGE / np.maximum(length, EDGE) / intervals)
    order = np.lexsort((rank, path))
    first = order[np.unique(path[order], return_index=True)[1]]
    out, met = np.full(count, np.inf), np.full(count, NO_FACE)
    met[path[first]], out[path[first]] = face[first], fraction[first]
    exact = first[through_face[first] & (fraction[first] > 0)]
    bracket = (begin[exact] / intervals, (begin[exact] + 1) / intervals)
    out[path[exact]] = _crossing(kinematics, surface, paths, path[exact], face[exact], shift[path[exact]], bracket)
    return out, met


def _constraints(
    surface: Surfaces, gap: np.ndarray, path: np.ndarray, k: np.ndarray, face: np.ndarray, position: np.ndarray,
    axis: np.ndarray,
) -> Float[np.ndarray, "rows 6"]:  # fmt: skip
    """Six lengths [mm], none above 0 where the wire's end is in the slab of a face; the first is the gap."""
    place, g = surface.place(face, position, axis), gap[path, k, face][:, None]
    return np.hstack([g, -g - surface.depth, -place, place - surface.size[face]])


def _clip(
    c0: Float[np.ndarray, "rows 6"], c1: Float[np.ndarray, "rows 6"]
) -> tuple[Float[np.ndarray, " rows"], Bool[np.ndarray, " rows"]]:
    """Fraction of an interval at which all constraints come to hold (inf: never), and whether the gap came last."""
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = c0 / (c0 - c1)
    enter = np.where(c0 > 0, np.where(c1 > 0, np.inf, crossing), 0.0)
    leave = np.where((c0 <= 0) & (c1 > 0), crossing, 1.0).min(axis=1)
    last = enter.max(axis=1)
    return np.where(last <= leave, last, np.inf), (enter[:, 0] >= last) & (c0[:, 0] > 0)


def _crossing(
    kinematics: Kinematics, surface: Surfaces, paths: Paths, path: np.ndarray, face: np.ndarray, shift: np.ndarray,
    bracket: tuple[np.ndarray, np.ndarray],
) -> Float[np.ndarray, " rows"]:  # fmt: skip
    """Fractions at which gaps vanish, by regula falsi with the Illinois rule; nearly straight lines need few steps."""

    def f(fraction: np.ndarray) -> np.ndarray:
        position, axis = paths.tips(kinematics, path, fraction)
        return surface.gap(position, axis)[np.arange(len(path)), face] - shift

    if not len(path):
        return np.empty(0)
    (a, b), fa, fb = bracket, f(bracket[0]), f(bracket[1])
    x = b
    for _ in range(12):
        x = np.where(fa == fb, b, (a * fb - b * fa) / np.where(fa == fb, 1.0, fb - fa))
        fx = f(x)
        if np.abs(fx).max() < 1e-9:
            break
        same = fx * fb > 0
        a, fa = np.where(same, a, b), np.where(same, 0.5 * fa, fb)
        b, fb = x, fx
    return np.asarray(x)
