"""What the robot must not hit: the solids of the jig and of the cell, or the faces of a jig without solids."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from identify.model.jig import Face, Jig
from identify.model.shape import Shape
from probe.motion.clusters import clusters
from probe.motion.distances import Boxes, Points, point_box, segment_box

PROBE = 1.0  # [mm] before and behind the middle of a face, to find the solid that it belongs to
THIN = 0.01  # [mm], of a plate, behind its face
LOOKS = np.linspace(0.05, 0.95, 7)  # along both edges of a face, for a solid behind it
PARTS = 32  # boxes around a mesh that stands still


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A solid that stands still: a box along the axes of the jig frame or of its own, or what lies in such a box."""

    lower: Float[np.ndarray, " 3"]  # [mm], along its own axes
    upper: Float[np.ndarray, " 3"]
    axes: Float[np.ndarray, "3 3"] | None = None  # own_R_jig; None: those of the jig
    name: str = ""
    shape: Shape | None = None  # a cylinder, a sphere or a mesh that lies in the box; its pose is in the jig frame

    @cached_property
    def parts(self) -> tuple[Float[np.ndarray, "parts 3"], Float[np.ndarray, "parts 3"]]:
        """Lower and upper corners of boxes, along its own axes, that hold all of it [mm]."""
        if self.shape is None or self.shape.kind != "mesh":
            return self.lower[None], self.upper[None]
        vertices, triangles = self.shape.mesh
        corners = vertices if self.axes is None else vertices @ self.axes.T
        groups = clusters(corners, triangles, PARTS)
        return np.stack([p.min(axis=0) for p in groups]), np.stack([p.max(axis=0) for p in groups])

    @property
    def top(self) -> float:
        """Height of its highest corner in the jig frame [mm]."""
        corners = np.array(list(product(*zip(self.lower, self.upper, strict=True))))
        return float((corners if self.axes is None else corners @ self.axes)[:, 2].max())

    def seen(self, p: Points) -> Points:
        """Points along its own axes."""
        return p if self.axes is None else self.axes @ p

    def point(self, p: Points) -> Float[np.ndarray, " rows"]:
        """Distances of points from its boxes [mm], 0 inside."""
        q = self.seen(p)
        return np.min([point_box(q, low, high) for low, high in zip(*self.parts, strict=True)], axis=0)

    def segment(self, start: Points, end: Points) -> Float[np.ndarray, " rows"]:
        """Distances of segments from its boxes [mm], 0 where they meet."""
        a, b = self.seen(start), self.seen(end)
        return np.min([segment_box(a, b, low, high) for low, high in zip(*self.parts, strict=True)], axis=0)


def obstacles(jig: Jig | None, others: Sequence[Shape] = ()) -> tuple[Obstacle, ...]:
    """The solids of a jig and of the cell, and the faces of the jig that no solid bears, as plates.

    Such a face leans over a staircase of boxes, or belongs to a jig without solids: a plate is blind to what is inside.
    """
    if jig is None:
        return tuple(_obstacle(shape) for shape in others)
    boxes = [Obstacle(np.array(box.lower), np.array(box.upper), name=f"box {i + 1}") for i, box in enumerate(jig.boxes)]
    solids = (*boxes, *(_obstacle(shape) for shape in jig.obstacles))
    plates = [_plate(face) for face in jig.faces if not _borne(face, solids)]
    return (*boxes, *plates, *solids[len(boxes) :], *(_obstacle(shape) for shape in others))


def boxes_around(solids: Sequence[Obstacle]) -> tuple[Boxes, ...]:
    """The boxes around obstacles, those with the same axes together."""
    groups = dict[bytes, list[int]]()
    for k, solid in enumerate(solids):
        groups.setdefault(b"" if solid.axes is None else solid.axes.tobytes(), []).append(k)
    out = []
    for group in groups.values():
        parts = [solids[k].parts for k in group]
        owner = np.repeat(group, [len(low) for low, _ in parts])
        lower, upper = (np.concatenate([part[side] for part in parts]).T for side in (0, 1))
        out.append(Boxes(solids[group[0]].axes, lower, upper, owner))
    return tuple(out)


def _obstacle(shape: Shape) -> Obstacle:
    """A shape in the box around it."""
    R, middle = shape.pose[:3, :3], shape.pose[:3, 3]
    axes = None if np.allclose(R, np.eye(3), atol=1e-12) else R.T
    if shape.kind == "mesh":
        vertices = shape.mesh[0] if axes is None else shape.mesh[0] @ R
        return Obstacle(vertices.min(axis=0), vertices.max(axis=0), axes, shape.name, shape)
    size = np.array(shape.size)
    half = {"box": size / 2, "cylinder": np.array([size[0], size[0], size[-1] / 2]), "sphere": np.full(3, size[0])}
    centre = middle if axes is None else axes @ middle
    return Obstacle(
        centre - half[shape.kind], centre + half[shape.kind], axes, shape.name, None if shape.kind == "box" else shape
    )


def _borne(face: Face, solids: Sequence[Obstacle]) -> bool:
    """Whether there is a solid behind a face wherever one looks; a mesh bears the faces that lie on it."""
    if any(solid.shape is not None and solid.shape.kind == "mesh" for solid in solids):
        return True
    s, t = (grid.ravel() for grid in np.meshgrid(LOOKS, LOOKS))
    behind = (face.point(s, t) - PROBE * face.normal).T
    return bool(solids) and bool((np.min([solid.point(behind) for solid in solids], axis=0) <= 0).all())


def _plate(face: Face) -> Obstacle:
    axes = np.stack([face.u / face.size[0], face.v / face.size[1], face.normal])
    corner = axes @ face.origin
    return Obstacle(
        corner - np.array([0.0, 0.0, THIN]), corner + np.array([*face.size, 0.0]), axes, f"face {face.name}"
    )


def owners(jig: Jig, solids: tuple[Obstacle, ...]) -> Bool[np.ndarray, "faces obstacles"]:
    """Whether a face lies on the surface of an obstacle: what a torch that touches it comes near of necessity."""
    middle = np.stack([face.point(np.array(0.5), np.array(0.5)) for face in jig.faces])
    normal = np.stack([face.normal for face in jig.faces])
    behind, before = (middle - PROBE * normal).T, (middle + PROBE * normal).T
    near = [_owned(solid, behind, before, PROBE * (solid.upper[2] - solid.lower[2] < PROBE)) for solid in solids]
    return np.stack(near, axis=1) if near else np.zeros((len(jig.faces), 0), dtype=bool)


def _owned(solid: Obstacle, behind: Points, before: Points, thick: float) -> Bool[np.ndarray, " faces"]:
    """Whether an obstacle holds points behind faces, and not those before them; a mesh, whether faces lie on it."""
    if solid.shape is not None and solid.shape.kind == "mesh":
        return _on_mesh(solid.shape, (behind + before) / 2)
    return np.asarray((solid.point(behind) <= thick) & (solid.point(before) > 0.5 * PROBE))


def _on_mesh(shape: Shape, points: Points) -> Bool[np.ndarray, " points"]:
    """Whether points lie on triangles of a mesh, to PROBE / 2."""
    vertices, triangles = shape.mesh
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    flat = size > 0
    a, b, c, normal = a[flat], b[flat], c[flat], normal[flat] / size[flat, None]
    out = np.zeros(points.shape[1], dtype=bool)
    for i, p in enumerate(points.T):
        inside = np.abs(((p - a) * normal).sum(axis=1)) <= PROBE / 2
        for one, other in ((a, b), (b, c), (c, a)):
            inside &= (np.cross(other - one, p - one) * normal).sum(axis=1) >= -1e-9 * size[flat]
        out[i] = inside.any()
    return out
