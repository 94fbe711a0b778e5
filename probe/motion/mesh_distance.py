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
        self.request, self.result = coal.CollisionRequest(), coal.CollisionResult()
        self.asked, self.told = coal.DistanceRequest(), coal.DistanceResult()

    def near(
        self, pair: Pair, frames: Sequence[Frames], rows: Int[np.ndarray, " rows"], margin: Float[np.ndarray, " rows"]
    ) -> Bool[np.ndarray, " rows"]:
        """Postures in which a moving solid comes nearer than a margin [mm] to another or to one that stands."""
        a, b, placed = self._placed(pair, frames, rows)
        out = np.zeros(len(rows), dtype=bool)
        for k, ((A, B), least) in enumerate(zip(placed, margin.tolist(), strict=True)):
            self.request.security_margin = least
            out[k] = self._meet(a.hull, A, b.hull, B)
            if out[k] and not (a.convex and b.convex):
                out[k] = self._meet(a.itself, A, b.itself, B)
        return out

    def _meet(self, a: Any, A: Any, b: Any, B: Any) -> bool:
        self.result.clear()
        return bool(coal.collide(a, A, b, B, self.request, self.result) > 0)

    def distances(
        self, pair: Pair, frames: Sequence[Frames], rows: Int[np.ndarray, " rows"]
    ) -> Float[np.ndarray, " rows"]:
        """Distances between a moving solid and another or one that stands [mm], 0 where they meet.

        Of meshes, those of their convex hulls, which are no larger: to meshes of many triangles they take thousands of
        times as long.
        """
        a, b, placed = self._placed(pair, frames, rows)
        out = np.zeros(len(rows))
        for k, (A, B) in enumerate(placed):
            self.told.clear()
            out[k] = max(coal.distance(a.hull, A, b.hull, B, self.asked, self.told), 0.0)
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
    start, end = np.array(one.start), np.array(one.end)
    length, local = float(np.linalg.norm(end - start)), np.eye(4)
    local[:3, 3] = (start + end) / 2
    if length > 0:
        local[:3, :3] = np.linalg.svd((end - start)[None])[2][[1, 2, 0]].T  # its axis is z
        local[:3, 0] *= np.sign(np.linalg.det(local[:3, :3]))
    return _same(coal.Capsule(one.radius, length)), local


@lru_cache(maxsize=128)
def _shape(shape: Shape) -> Solid:
    if shape.kind == "box":
        return _same(coal.Box(*shape.size))
    if shape.kind == "cylinder":
        return _same(coal.Cylinder(*shape.size))
    if shape.kind == "sphere":
        return _same(coal.Sphere(*shape.size))
    vertices, triangles = shape.mesh
    corners = coal.StdVec_Triangle()
    for a, b, c in triangles.tolist():
        corners.append(coal.Triangle(a, b, c))
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(vertices))
    model.addSubModel(_points(vertices), corners)
    model.endModel()
    return Solid(model, _hull(vertices) or model)


def _points(vertices: Float[np.ndarray, "vertices 3"]) -> Any:
    points = coal.StdVec_Vec3s()
    for vertex in vertices:
        points.append(vertex)
    return points


def _hull(vertices: Float[np.ndarray, "vertices 3"]) -> Any:
    """The convex hull of a mesh; None of one that is flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        outer = ConvexHull(vertices).vertices
    except QhullError:
        return None
    return coal.Convex.convexHull(_points(vertices[outer]), True, "Qt")


def _standing(solid: Obstacle) -> tuple[Solid, Any]:
    R = np.eye(3) if solid.axes is None else solid.axes.T
    middle = R @ (solid.lower + solid.upper) / 2
    return _same(coal.Box(*np.maximum(solid.upper - solid.lower, THINNEST).tolist())), coal.Transform3s(R, middle)
