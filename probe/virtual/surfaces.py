"""What a wire can touch: the faces of a jig, the sides of its boxes that are no faces, and obstacles.

The point of the wire's end that matters is the one that lies deepest along a normal: the end of a point, the pole of a
ball, a point of the rim of a flat end, `h = radius sqrt(1 - (n.a)^2)` before the tip (DESIGN section 3).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Wire
from identify.model.jig import Face, Jig
from identify.model.shape import Shape, entries

SHALLOW = 0.5  # [mm], least depth of the slab under a face
DEEP = 10.0  # [mm], how far below a face still is the inside of a jig that has no boxes


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What conducts: the faces of a jig, those sides of its boxes that are no faces, and other shapes."""

    names: tuple[str, ...]  # of the rectangles, then of the shapes
    origin: Float[np.ndarray, "surfaces 3"]  # [mm]
    u: Float[np.ndarray, "surfaces 3"]  # unit vectors
    v: Float[np.ndarray, "surfaces 3"]
    normal: Float[np.ndarray, "surfaces 3"]
    size: Float[np.ndarray, "surfaces 2"]  # [mm]
    boxes: Float[np.ndarray, "boxes 2 3"]  # [mm], lower and upper corners
    flat: float  # [mm], radius of a flat wire end
    ball: float  # [mm], radius of a ball
    shapes: tuple[Shape, ...] = ()  # what stands there besides: leaning boxes, cylinders, spheres, meshes

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

    def closed(
        self, position: Float[np.ndarray, "rows 3"], axis: Float[np.ndarray, "rows 3"], gap: Float[np.ndarray, "rows s"]
    ) -> Bool[np.ndarray, " rows"]:
        """Whether a wire touches: it is in the slab under a face, inside a box, or in or under another shape."""
        depth = self.depth if len(self.boxes) else max(DEEP, self.depth)
        row, face = np.nonzero((gap <= 0) & (gap >= -depth))
        place = self.place(face, position[row], axis[row])
        p = position[:, None]
        within = np.any(np.all((p > self.boxes[:, 0]) & (p < self.boxes[:, 1]), axis=2), axis=1)
        within[row[((place >= 0) & (place <= self.size[face])).all(axis=1)]] = True
        for shape in self.shapes:  # its surface is between the tip and a place further up the wire
            within |= np.isfinite(entries(shape, position, -self.depth * axis))
        return np.asarray(within)


def surfaces(
    jig: Jig, wire: Wire, proud: Mapping[str, float] | None = None, obstacles: tuple[Shape, ...] = ()
) -> Surfaces:
    """What a wire can touch: a jig whose faces stand `proud` of their drawing [mm], and obstacles of the cell."""
    drawn = _drawn(jig, wire)
    shapes = (*jig.obstacles, *obstacles)
    names = (*drawn.names, *(shape.name for shape in shapes))
    shift = np.array([(proud or {}).get(name, 0.0) for name in drawn.names])
    return replace(drawn, names=names, shapes=shapes, origin=drawn.origin + shift[:, None] * drawn.normal)


@lru_cache(maxsize=8)
def _drawn(jig: Jig, wire: Wire) -> Surfaces:
    faces = [*jig.faces, *_sides(jig)]
    u, v, normal = (np.array([getattr(face, key) for face in faces]) for key in ("u", "v", "normal"))
    size = np.array([face.size for face in faces])
    return Surfaces(
        names=tuple(face.name for face in faces),
        origin=np.array([face.origin for face in faces]),
        u=u / size[:, :1],
        v=v / size[:, 1:],
        normal=normal,
        size=size,
        boxes=np.array([(box.lower, box.upper) for box in jig.boxes], dtype=float).reshape(-1, 2, 3),
        flat=wire.flat,
        ball=wire.ball,
    )


def _sides(jig: Jig) -> list[Face]:
    """Sides of the boxes that lie in the plane of no face, the table around the jig for instance."""
    planes = {(*face.normal.round(6), round(face.offset, 3)) for face in jig.faces}
    faces = []
    for i, box in enumerate(jig.boxes):
        lower, edges = np.array(box.lower, dtype=float), np.diag(np.subtract(box.upper, box.lower))
        for axis in range(3):
            u, v = edges[(axis + 1) % 3], edges[(axis + 2) % 3]
            for origin, a, b in ((lower, v, u), (lower + edges[axis], u, v)):
                side = Face(f"box {i + 1}", origin, a, b)
                if (*side.normal.round(6), round(side.offset, 3)) not in planes:
                    faces.append(side)
    return faces
