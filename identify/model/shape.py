"""Solids that move with the links of a robot, as a URDF tells them: what the robot must not hit anything with."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from identify.model.files import InputError, Mistake
from identify.model.meshes import READERS, read_mesh

PRIMITIVES = ("box", "cylinder", "sphere")
WIDEST = 30_000.0  # [mm], a wider link was drawn in millimetres
PAIRS = 1 << 17  # lines and triangles that are looked at together, for the cache


@dataclass(frozen=True, eq=False)
class Shape:
    """A box, a cylinder, a sphere or a mesh; a mesh is read from its file when first asked for."""

    link: int  # 0 stands still, N carries the torch
    name: str  # of the URDF's link
    kind: str  # box, cylinder, sphere, mesh, or what else the URDF says, which is not read
    size: tuple[float, ...]  # [mm] edges of a box; radius and length of a cylinder; radius; mm per unit of a mesh
    pose: Float[np.ndarray, "4 4"]  # link_T_shape [mm]
    file: str = ""  # of a mesh, as the URDF names it
    path: Path | None = None  # where that was found

    @property
    def readable(self) -> bool:
        """Whether it is of a kind that is read, and its mesh was found."""
        return self.kind in PRIMITIVES or (self.path is not None and self.path.suffix.lower() in READERS)

    @cached_property
    def mesh(self) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "triangles 3"]]:
        """Vertices [mm] in the frame of the link, and triangles; raises InputError where the file is broken."""
        assert self.path is not None
        vertices, triangles = read_mesh(self.path)
        if (width := float(np.ptp(vertices * self.size, axis=0).max())) > WIDEST:
            text = f"the mesh of link '{self.name}' is {width / 1000:.0f} m wide: drawn in millimetres?"
            cure = 'a URDF is in metres; write <mesh ... scale="0.001 0.001 0.001"/>'
            raise InputError([Mistake(str(self.path), 0, f"{text} {cure}")])
        return (vertices * self.size) @ self.pose[:3, :3].T + self.pose[:3, 3], triangles

    def with_triangles(self, triangles: Int[np.ndarray, "some 3"]) -> "Shape":
        """The mesh with these triangles alone."""
        other = replace(self)
        other.__dict__["mesh"] = self.mesh[0], triangles
        return other


def entries(
    shape: Shape, start: Float[np.ndarray, "lines 3"], way: Float[np.ndarray, "lines 3"]
) -> Float[np.ndarray, " lines"]:
    """Where straight ways come into a solid, as shares of them: 0 where they begin in it, inf where they never do.

    Of a mesh, where they first come through its surface (Moeller and Trumbore 1997).
    """
    if shape.kind == "mesh":
        return _through(shape, start, way)
    p, d = (start - shape.pose[:3, 3]) @ shape.pose[:3, :3], way @ shape.pose[:3, :3]
    size = np.array(shape.size)
    parts = {
        "box": lambda: _between(p, d, size / 2),
        "cylinder": lambda: np.concatenate(
            [_round(p[:, :2], d[:, :2], size[0]), _between(p[:, 2:], d[:, 2:], size[1:] / 2)], axis=2
        ),
        "sphere": lambda: _round(p, d, size[0]),
    }
    spans = parts[shape.kind]()
    enter, leave = spans[0].max(axis=1), spans[1].min(axis=1)
    return np.where((enter <= leave) & (leave >= 0) & (enter <= 1), np.maximum(enter, 0.0), np.inf)


def _between(
    p: Float[np.ndarray, "lines axes"], d: Float[np.ndarray, "lines axes"], half: Float[np.ndarray, " axes"]
) -> Float[np.ndarray, "2 lines axes"]:
    """Where lines enter and leave slabs around 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(-half - p) / d, (half - p) / d])
    within = np.where(np.abs(p) <= half, np.inf, -np.inf)
    return np.where(d == 0, np.stack([-within, within]), np.sort(ends, axis=0))


def _round(
    p: Float[np.ndarray, "lines axes"], d: Float[np.ndarray, "lines axes"], radius: float
) -> Float[np.ndarray, "2 lines 1"]:
    """Where lines enter and leave a circle or a sphere around 0."""
    a, b, c = (d * d).sum(axis=1), (p * d).sum(axis=1), (p * p).sum(axis=1) - radius**2
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        ends = np.stack([(-b - root) / a, (-b + root) / a])
    within = np.where(c <= 0, np.inf, -np.inf)
    ends = np.where(a == 0, np.stack([-within, within]), ends)
    return np.where((a > 0) & (b * b < a * c), np.array([[np.inf], [-np.inf]]), ends)[:, :, None]


def _through(
    shape: Shape, start: Float[np.ndarray, "lines 3"], way: Float[np.ndarray, "lines 3"]
) -> Float[np.ndarray, " lines"]:
    """Where lines first come through a triangle of a mesh."""
    vertices, triangles = shape.mesh
    corners, out = vertices[triangles], np.full(len(start), np.inf)
    end = start + way
    low, high = np.minimum(start, end).min(axis=0, initial=np.inf), np.maximum(start, end).max(axis=0, initial=-np.inf)
    corners = corners[((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)]
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    for begin in range(0, len(start), step := max(1, PAIRS // max(len(a), 1))):
        some = slice(begin, begin + step)
        h, s = np.cross(way[some, None], v), start[some, None] - a
        det = (h * u).sum(axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            x, q = (s * h).sum(axis=2) / det, np.cross(s, u)
            y, at = (q * way[some, None]).sum(axis=2) / det, (q * v).sum(axis=2) / det
            met = (x >= 0) & (y >= 0) & (x + y <= 1) & (at >= 0) & (at <= 1)
        out[some] = np.where(met, at, np.inf).min(axis=1, initial=np.inf)
    return out
