"""Whether solids themselves come near each other: meshes, boxes, cylinders, spheres and capsules, by `coal`.

A mesh is its surface: what lies wholly inside it is not seen, but no way leads there past the surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import coal
import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.joint import Capsule
from identify.model.shape import Shape
from probe.motion.distances import Points
from probe.motion.obstacles import Obstacle

THINNEST = 1e-3  # [mm], of a plate
Frames = Float[np.ndarray, "postures 3 4"]  # jig_T_link
Pair = tuple[int, int | None, int | None]  # number of a moving solid, and that of another or of one that stands


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid as `coal` has it, and the convex hull of a mesh, or the solid again: quick to ask."""

    itself: Any
    hull: Any

    @property
    def convex(self) -> bool:
        """Whether the hull is all there is to it."""
        return self.itself is self.hull


class Exact:
    """The solids that move with links among those that stand still, each by its number."""

    def __init__(self, moving: Sequence[Shape | Capsule], standing: Sequence[Obstacle]) -> None:
        self.moving = [(one.link, *_solid(one)) for one in moving]
        self.standing = [_standing(solid) for solid in standing]
        self.collision, self.contacts = coal.CollisionRequest(), coal.CollisionResult()
        self.distance, self.nearest = coal.DistanceRequest(), coal.DistanceResult()

    def near(
        self, pair: Pair, frames: Sequence[Frames], rows: Int[np.ndarray, " rows"], margin: Float[np.ndarray, " rows"]
    ) -> Bool[np.ndarray, " rows"]:
        """Postures in which a moving solid comes nearer than a margin [mm] to another or to one that stands."""
        a, b, placed = self._placed(pair, frames, rows)
        return np.array(
            [self._near(a, A, b, B, m) for (A, B), m in zip(placed, margin.tolist(), strict=True)], dtype=bool
        )

    def segments_near(
        self, k: int, start: Points, end: Points, margin: Float[np.ndarray, " rows"]
    ) -> Bool[np.ndarray, " rows"]:
        """Segments that come nearer than a margin [mm] to a solid that stands."""
        b, B = self.standing[k]
        out = np.zeros(start.shape[1], dtype=bool)
        for i, (p, q, m) in enumerate(zip(start.T, end.T, margin.tolist(), strict=True)):
            line, A = _capsule(p, q, THINNEST)
            out[i] = self._near(_same(line), coal.Transform3s(A[:3, :3], A[:3, 3]), b, B, m)
        return out

    def segment_distances(self, k: int, start: Points, end: Points) -> Float[np.ndarray, " rows"]:
        """Distances of segments from a solid that stands [mm], 0 where they meet."""
        b, B = self.standing[k]
        out = np.zeros(start.shape[1])
        for i, (p, q) in enumerate(zip(start.T, end.T, strict=True)):
            line, A = _capsule(p, q, THINNEST)
            self.nearest.clear()
            place = coal.Transform3s(A[:3, :3], A[:3, 3])
            out[i] = max(coal.distance(line, place, b.itself, B, self.distance, self.nearest), 0.0)
        return out

    def _near(self, a: Solid, A: Any, b: Solid, B: Any, margin: float) -> bool:
        self.collision.security_margin = margin
        if not self._meet(a.hull, A, b.hull, B):
            return False
        return (a.convex and b.convex) or self._meet(a.itself, A, b.itself, B)

    def _meet(self, a: Any, A: Any, b: Any, B: Any) -> bool:
        self.contacts.clear()
        return bool(coal.collide(a, A, b, B, self.collision, self.contacts) > 0)

    def distances(
        self, pair: Pair, frames: Sequence[Frames], rows: Int[np.ndarray, " rows"]
    ) -> Float[np.ndarray, " rows"]:
        """Distances between a moving solid and another or one that stands [mm], 0 where they meet.

        Of meshes that move, those of their convex hulls, which are no larger: to meshes of many triangles they take
        thousands of times as long. A mesh that stands is a fixture, which a hull would close.
        """
        a, b, placed = self._placed(pair, frames, rows)
        other = b.hull if pair[2] is None else b.itself
        out = np.zeros(len(rows))
        for i, (A, B) in enumerate(placed):
            self.nearest.clear()
            out[i] = max(coal.distance(a.hull, A, other, B, self.distance, self.nearest), 0.0)
        return out

    def _placed(
        self, pair: Pair, frames: Sequence[Frames], rows: Int[np.ndarray, " rows"]
    ) -> tuple[Solid, Solid, list[tuple[Any, Any]]]:
        """Two solids, and where they are in some postures."""
        i, j, k = pair
        a, A = self._moved(i, frames, rows)
        if k is not None:
            b, place = self.standing[k]
            return a, b, [(one, place) for one in A]
        assert j is not None
        b, B = self._moved(j, frames, rows)
        return a, b, list(zip(A, B, strict=True))

    def _moved(self, i: int, frames: Sequence[Frames], rows: Int[np.ndarray, " rows"]) -> tuple[Solid, list[Any]]:
        link, solid, local = self.moving[i]
        T = frames[link][rows] @ local
        return solid, [coal.Transform3s(one[:, :3], one[:, 3]) for one in T]


def _same(one: Any) -> Solid:
    return Solid(one, one)


def _solid(one: Shape | Capsule) -> tuple[Solid, Float[np.ndarray, "4 4"]]:
    """A solid as coal has it, and where that stands on its link."""
    if isinstance(one, Shape):
        return _shape(one), np.eye(4) if one.kind == "mesh" else one.pose
    capsule, local = _capsule(np.array(one.start), np.array(one.end), one.radius)
    return _same(capsule), local


def _capsule(
    start: Float[np.ndarray, " 3"], end: Float[np.ndarray, " 3"], radius: float
) -> tuple[Any, Float[np.ndarray, "4 4"]]:
    """A capsule as coal has it, along z, and where that stands."""
    length, local = float(np.linalg.norm(end - start)), np.eye(4)
    local[:3, 3] = (start + end) / 2
    if length > 0:
        local[:3, :3] = np.linalg.svd((end - start)[None])[2][[1, 2, 0]].T
        local[:3, 0] *= np.sign(np.linalg.det(local[:3, :3]))
    return coal.Capsule(radius, length), local


@lru_cache(maxsize=128)
def _shape(shape: Shape) -> Solid:
    if shape.kind == "box":
        return _same(coal.Box(*shape.size))
    if shape.kind == "cylinder":
        return _same(coal.Cylinder(*shape.size))
    if shape.kind == "sphere":
        return _same(coal.Sphere(*shape.size))
    vertices, triangles = shape.mesh
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(vertices))
    model.addVertices(vertices)
    model.addTriangles(triangles)
    model.endModel()
    return Solid(model, _hull(vertices) or model)


def _hull(vertices: Float[np.ndarray, "vertices 3"]) -> Any:
    """The convex hull of a mesh; None of one that is flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        outer = ConvexHull(vertices).vertices
    except QhullError:
        return None
    points = coal.StdVec_Vec3s()
    for vertex in vertices[outer]:
        points.append(vertex)
    return coal.Convex.convexHull(points, True, "Qt")


def _standing(solid: Obstacle) -> tuple[Solid, Any]:
    if solid.shape is not None:
        T = np.eye(4) if solid.shape.kind == "mesh" else solid.shape.pose
        return _shape(solid.shape), coal.Transform3s(T[:3, :3], T[:3, 3])
    R = np.eye(3) if solid.axes is None else solid.axes.T
    middle = R @ (solid.lower + solid.upper) / 2
    return _same(coal.Box(*np.maximum(solid.upper - solid.lower, THINNEST).tolist())), coal.Transform3s(R, middle)
