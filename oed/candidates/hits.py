"""What robots that may be off meet with a search: its face, the outside of it, something else first, or nothing."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache, cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.shape import Shape, entries
from probe.motion.obstacles import Obstacle, obstacles

PLACES = 128  # of the tip, by which touches are chosen
SEED = 11
TINY = 1e-9  # [mm^2], so that a tip that cannot be off has places, too
SURE = 0.98  # share of the robots that should meet a touch, or that which
SUREST = 0.1  # of the postures of its face reach;
POOR = 0.8  # where that is less, all postures are asked for: there is nothing sure on such a face
BLOCK = 250  # touches looked at together, for the cache
PLASTIC = np.array([0.7548776662466927, 0.5698402909980532])  # 1/x, 1/x^2 of x^3 = x + 1 (Roberts 2018)
HAIR = 1e-3  # of the approach: a mesh that a face lies on is not met before the face
RISES = 0.1  # [mm] over the plane of a face
TOWARDS = 0.05  # cosine between two normals, above which a search for one face also goes down to the other


class Outcome(IntEnum):
    """What a search ends with."""

    MEETS = 0
    SLIDES = 1
    OTHER = 2
    BEHIND = 3
    SHORT = 4


MISSES = {
    Outcome.SLIDES: "pass beside their face",
    Outcome.OTHER: "meet another face first",
    Outcome.BEHIND: "begin in contact or behind their face",
    Outcome.SHORT: "end before their face",
}


@dataclass(frozen=True, eq=False)
class Hits:
    """Searches of robots of which so much is known."""

    cell: Cell
    theta: Float[np.ndarray, " parameters"]  # [mm, rad]
    root: Float[np.ndarray, "parameters directions"]  # of the covariance root root' of the robots around theta
    least: Float[np.ndarray, " faces"] | None = None  # share of the robots that a touch has to be met by; None: any

    def robots(self, count: int) -> Float[np.ndarray, "robots parameters"]:
        """By how much robots differ from theta, each direction at the same quantiles (Latin hypercube) [mm, rad]."""
        from scipy.special import ndtri

        quantiles = np.tile(ndtri((np.arange(count) + 0.5) / count), (self.root.shape[1], 1))
        return np.asarray((self.root @ np.random.default_rng(SEED).permuted(quantiles, axis=1)).T)

    def share(
        self, face: Int[np.ndarray, " touches"], q: Float[np.ndarray, "touches joints"]
    ) -> Float[np.ndarray, " touches"]:
        """The share of the robots whose search meets its face.

        Each touch has PLACES places of the tip, spread evenly over what the tip may be off (Hammersley): touches that
        are compared by their shares, and moved to where these are best, are then not chosen for the luck of a draw.
        """
        points, root = _normal_points(), self.root

        def off(i: int, J: Float[np.ndarray, "some 3 parameters"]) -> Float[np.ndarray, "places some 3"]:
            one = self.cell.the_jig.faces[i]
            axes = np.stack([one.normal, one.u / one.size[0], np.cross(one.normal, one.u / one.size[0])])
            A = axes @ J @ root
            L = np.linalg.cholesky(A @ A.transpose(0, 2, 1) + TINY * np.eye(3))  # the normal first: its own quantiles
            spread = np.einsum("mij,ip->jmp", L, axes)
            return (points @ spread.reshape(3, -1)).reshape(PLACES, -1, 3)

        return np.asarray((self._outcomes(face, q, PLACES, off) == Outcome.MEETS).mean(axis=0))

    def requiring(self, face: Int[np.ndarray, " touches"], share: Float[np.ndarray, " touches"]) -> "Hits":
        """The same, with what surely meets a face to be asked for: SURE, or what the surest postures have."""
        least = np.zeros(len(self.cell.the_jig.faces))
        for i in np.unique(face):
            surest = np.percentile(share[face == i], 100 * (1 - SUREST))
            least[i] = min(SURE, surest) if surest > POOR else 0.0
        return replace(self, least=least)

    def sure(
        self, face: Int[np.ndarray, " touches"], share: Float[np.ndarray, " touches"]
    ) -> Bool[np.ndarray, " touches"]:
        """Whether touches that this share of the robots meets are sure enough."""
        return np.ones(len(face), dtype=bool) if self.least is None else share >= self.least[face]

    def outcomes(
        self,
        face: Int[np.ndarray, " touches"],
        q: Float[np.ndarray, "touches joints"],
        robots: Float[np.ndarray, "robots parameters"],
    ) -> Int[np.ndarray, "robots touches"]:
        """What robots that differ so much from theta meet with each touch."""
        return self._outcomes(
            face, q, len(robots), lambda i, J: (robots @ J.reshape(-1, J.shape[2]).T).reshape(len(robots), -1, 3)
        )

    def _outcomes(
        self,
        face: Int[np.ndarray, " touches"],
        q: Float[np.ndarray, "touches joints"],
        many: int,
        off: Callable[[int, np.ndarray], np.ndarray],
    ) -> Int[np.ndarray, "many touches"]:
        """What searches meet, each of which as a whole is off by what its tip is off at contact, to first order."""
        out = np.empty((many, len(q)), dtype=np.int8)
        approach = self.cell.touch.approach
        for i in np.unique(face).tolist():
            mine, normal = np.flatnonzero(face == i), self.cell.the_jig.faces[i].normal
            for begin in range(0, len(mine), BLOCK):
                some = mine[begin : begin + BLOCK]
                tip, J = self.cell.kinematics.tip_jacobian(q[some], self.theta)
                extent = tip @ normal - self.cell.the_jig.faces[i].offset
                start = tip + approach * normal + off(i, J)
                out[:, some] = self.outcome(i, start, -approach * normal, extent)
        return out

    def outcome(
        self,
        face: int,
        start: Float[np.ndarray, "robots touches 3"],
        way: Float[np.ndarray, "*searches 3"],
        extent: Float[np.ndarray, " touches"],
    ) -> Int[np.ndarray, "robots touches"]:
        """What straight searches for a face meet, from the start of each by the `way` to the planned contact and on.

        The way may be one for all. `extent` is how far the middle of the wire's end stays off a face at contact [mm].
        """
        own, reach = self._rectangles[face], self.cell.touch.travel / self.cell.touch.approach
        at, inside = own.crossing(start, way, extent)
        out = np.where(inside, Outcome.MEETS, Outcome.SLIDES).astype(np.int8)
        end = start + reach * way
        low, high = np.minimum(start, end).min(axis=0), np.maximum(start, end).max(axis=0)
        for other in self._others[face]:
            near = other.near(low, high)
            some = way if way.ndim == 1 else way[:, near]
            there, within = other.crossing(start[:, near], some, extent[near])
            first = within & (there >= 0) & (there < np.minimum(at[:, near], reach))
            out[:, near] = np.where(first, Outcome.OTHER, out[:, near])
        out[(at >= reach) & (out != Outcome.OTHER)] = Outcome.SHORT
        out[at <= 0] = Outcome.BEHIND
        for solid, box in zip(self._solids, self._around, strict=True):
            near = box.near(low, high)
            contact = solid.point(start[:, near].reshape(-1, 3).T) <= 0
            out[:, near] = np.where(contact.reshape(len(start), len(near)), Outcome.BEHIND, out[:, near])
        for shape, box in self._shapes[face]:
            near = box.near(low, high)
            whole = np.broadcast_to(reach * (way if way.ndim == 1 else way[:, near]), (len(start), len(near), 3))
            there = entries(shape, start[:, near].reshape(-1, 3), whole.reshape(-1, 3)).reshape(whole.shape[:2])
            first = reach * there < at[:, near] - HAIR
            why = np.where(there > 0, Outcome.OTHER, Outcome.BEHIND)
            out[:, near] = np.where(first & (out[:, near] != Outcome.BEHIND), why, out[:, near])
        return out

    @cached_property
    def _shapes(self) -> list[list[tuple[Shape, "_Bounds"]]]:
        """For each face the cylinders, spheres and meshes that a search for it could meet, and the bounds of each."""
        shapes = [solid.shape for solid in obstacles(self.cell.jig, self.cell.obstacles) if solid.shape is not None]
        return [
            [(part, _Bounds.of(_extent(part))) for shape in shapes if (part := own.before_it(shape)) is not None]
            for own in self._rectangles
        ]

    @cached_property
    def _solids(self) -> list[Obstacle]:
        """Boxes, straight or leaning: a search that begins in one begins in contact."""
        return [solid for solid in obstacles(self.cell.jig, self.cell.obstacles) if solid.shape is None]

    @cached_property
    def _around(self) -> list["_Bounds"]:
        """What is around each of them, along the axes of the jig."""
        return [_Bounds.of(np.concatenate([side.corners for side in _sides(solid)])) for solid in self._solids]

    @cached_property
    def _rectangles(self) -> list["_Rectangle"]:
        return [_Rectangle(f.origin, f.u, f.v, f.normal) for f in self.cell.the_jig.faces]

    @cached_property
    def _others(self) -> list[list["_Rectangle"]]:
        """For each face the other faces, and sides of boxes, that a search for it could meet from outside."""
        sides = [side for solid in self._solids for side in _sides(solid)]
        every = [*self._rectangles, *sides]
        return [[other for other in every if other is not own and other.before(own)] for own in self._rectangles]


@dataclass(frozen=True, eq=False)
class _Bounds:
    """A box along the axes of the jig around something [mm]."""

    low: Float[np.ndarray, " 3"]
    high: Float[np.ndarray, " 3"]

    @classmethod
    def of(cls, points: Float[np.ndarray, "points 3"]) -> "_Bounds":
        """The box around points."""
        return cls(points.min(axis=0), points.max(axis=0))

    def near(
        self, low: Float[np.ndarray, "touches 3"], high: Float[np.ndarray, "touches 3"]
    ) -> Int[np.ndarray, " some"]:
        """The boxes that meet this one."""
        return np.flatnonzero(((high >= self.low) & (low <= self.high)).all(axis=1))


@dataclass(frozen=True, eq=False)
class _Rectangle:
    """A rectangle seen from outside: a face, or a side of a box."""

    origin: Float[np.ndarray, " 3"]  # [mm]
    u: Float[np.ndarray, " 3"]  # [mm]
    v: Float[np.ndarray, " 3"]
    normal: Float[np.ndarray, " 3"]

    @cached_property
    def corners(self) -> Float[np.ndarray, "4 3"]:
        """Its corners [mm]."""
        return self.origin + np.array([0 * self.u, self.u, self.v, self.u + self.v])

    def near(
        self, low: Float[np.ndarray, "touches 3"], high: Float[np.ndarray, "touches 3"]
    ) -> Int[np.ndarray, " some"]:
        """The boxes that meet the one around the rectangle."""
        return _Bounds.of(self.corners).near(low, high)

    def before(self, other: "_Rectangle") -> bool:
        """Whether a search for another face may meet this one, which lies in another plane."""
        apart = abs(float(self.normal @ (self.origin - other.origin)))
        cosine = float(self.normal @ other.normal)
        return cosine > TOWARDS and not (cosine > 1 - 1e-9 and apart < 1e-3)

    def before_it(self, shape: Shape) -> Shape | None:
        """What of a solid a search for this face may meet before it: of a mesh, what rises over its plane."""
        if shape.kind != "mesh":
            return shape
        vertices, triangles = shape.mesh
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        normal, high = np.cross(b - a, c - a), ((vertices - self.origin) @ self.normal)[triangles].max(axis=1)
        towards = np.abs(normal @ self.normal) > TOWARDS * np.linalg.norm(normal, axis=1)
        some = triangles[towards & (high > RISES)]
        return shape.with_triangles(some) if len(some) else None

    @cached_property
    def _axes(self) -> Float[np.ndarray, "3 3"]:
        """Height over the plane [mm], and fractions of u and v."""
        return np.stack([self.normal, self.u / (self.u @ self.u), self.v / (self.v @ self.v)])

    def crossing(
        self,
        start: Float[np.ndarray, "robots touches 3"],
        way: Float[np.ndarray, "*searches 3"],
        extent: Float[np.ndarray, " touches"],
    ) -> tuple[Float[np.ndarray, "robots touches"], Bool[np.ndarray, "robots touches"]]:
        """Where each search comes to the plane, 1 being the planned contact, and whether on the rectangle."""
        height, s, t = (np.asarray(start @ a - a @ self.origin) for a in self._axes)
        down, along, across = (np.asarray(way @ a) for a in self._axes)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.where(down < 0, (extent - height) / down, np.inf)
            s, t = s + at * along, t + at * across  # NaN where the search never comes there
        return at, (s > 0) & (s < 1) & (t > 0) & (t < 1)


@cache
def _normal_points() -> Float[np.ndarray, "places 3"]:
    """Points spread as a normal distribution is, evenly in the first axis, nearly so in the others (Hammersley)."""
    from scipy.special import ndtri

    i = np.arange(PLACES)[:, None] + 0.5
    return np.asarray(ndtri(np.hstack([i / PLACES, i * PLASTIC % 1])))


def _extent(shape: Shape) -> Float[np.ndarray, "points 3"]:
    """Points whose box along the axes of the jig holds a solid [mm]."""
    if shape.kind == "mesh":
        vertices, triangles = shape.mesh
        return vertices[triangles.ravel()]
    return shape.pose[:3, 3] + float(np.linalg.norm(shape.size)) * np.array([[-1.0], [1.0]])


def _sides(solid: Obstacle) -> list[_Rectangle]:
    """The six sides of a box."""
    axes = np.eye(3) if solid.axes is None else solid.axes
    size, out = solid.upper - solid.lower, []
    for k in range(3):
        u, v = ((size[j] * axes[j]) for j in ((k + 1) % 3, (k + 2) % 3))
        low, high = axes.T @ solid.lower, axes.T @ solid.upper
        out.append(_Rectangle(high - u - v, u, v, axes[k]))
        out.append(_Rectangle(low, v, u, -axes[k]))
    return out
