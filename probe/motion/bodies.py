"""The solids of an arm as its URDF describes them, each with capsules around it, and what is not described."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.util import find_spec

import numpy as np
from jaxtyping import Float

from identify.model.joint import Capsule
from identify.model.robot import Robot
from identify.model.shape import Shape
from probe.motion.clusters import clusters

EXTRA = "touchcal[collision]"
PARTS = 24  # capsules around the parts of a mesh


@dataclass(frozen=True, eq=False)
class Body:
    """A solid that moves with a link. What is clear of the capsule, or of all the parts, is clear of the solid."""

    shape: Shape
    capsule: Capsule

    @cached_property
    def parts(self) -> tuple[Capsule, ...]:
        """Smaller capsules that together hold all of it."""
        if self.shape.kind != "mesh":
            return (self.capsule,)
        vertices, triangles = self.shape.mesh
        return tuple(_around(self.shape.link, points) for points in clusters(vertices, triangles, PARTS))


def bodies(robot: Robot) -> tuple[Body, ...]:
    """The shapes of a robot that can be read; raises InputError where the file of a mesh is broken."""
    return tuple(_body(shape) for shape in robot.shapes if shape.readable)


@lru_cache(maxsize=128)
def _body(shape: Shape) -> Body:
    return Body(shape, around(shape))


def exact_meshes() -> bool:
    """Whether the extra is installed that compares solids themselves."""
    return find_spec("coal") is not None


def notes(robot: Robot) -> tuple[str, ...]:
    """What a person should know of how the arm is kept clear: one sentence each."""
    out, lost = list[str](), [s for s in robot.shapes if s.kind == "mesh" and s.path is None]
    strange = [s for s in robot.shapes if s not in lost and not s.readable]
    if lost:
        out.append(
            f"collision: {_meshes(lost)} not found beside the URDF or in the folders above it, '{lost[0].file}' of "
            f"link '{lost[0].name}' first: nothing keeps {_links(lost)} clear; put the files where the URDF says"
        )
    if strange:
        what = strange[0].file or f"<{strange[0].kind}>"
        out.append(
            f"collision: '{what}' of link '{strange[0].name}' is of a kind that is not read: nothing keeps "
            f"{_links(strange)} clear; write STL or OBJ meshes, boxes, cylinders or spheres"
        )
    if len(lost) + len(strange) < len(robot.shapes) and not exact_meshes():
        out.append(
            f"collision: the arm is judged by capsules around its shapes; to judge the shapes themselves: "
            f"pip install '{EXTRA}' (Linux, macOS)"
        )
    return tuple(out)


def _meshes(shapes: list[Shape]) -> str:
    return f"{len(shapes)} meshes are" if len(shapes) > 1 else "a mesh is"


def _links(shapes: list[Shape]) -> str:
    names = list(dict.fromkeys(f"'{shape.name}'" for shape in shapes))
    return f"link{'s' if len(names) > 1 else ''} {', '.join(names)}"


def around(shape: Shape) -> Capsule:
    """A small capsule that holds all of a shape."""
    R, middle = shape.pose[:3, :3], shape.pose[:3, 3]
    if shape.kind == "sphere":
        return _capsule(shape.link, middle, middle, shape.size[0])
    if shape.kind == "cylinder":
        radius, length = shape.size
        return _capsule(shape.link, middle - R[:, 2] * length / 2, middle + R[:, 2] * length / 2, radius)
    if shape.kind == "box":
        edges = np.array(shape.size)
        long = int(edges.argmax())
        half = R[:, long] * edges[long] / 2
        return _capsule(shape.link, middle - half, middle + half, float(np.hypot(*np.delete(edges, long)) / 2))
    points, triangles = shape.mesh
    return _around(shape.link, points[np.unique(triangles)])


def _around(link: int, points: Float[np.ndarray, "points 3"]) -> Capsule:
    """The smallest of the capsules along the axes and the principal directions of points that holds them."""
    directions = [*np.eye(3), *np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]]
    return min((_along(link, points, u) for u in directions), key=_volume)


def _along(link: int, points: Float[np.ndarray, "points 3"], u: Float[np.ndarray, " 3"]) -> Capsule:
    """A capsule along a direction that holds points: as thick as they are across it, then as short as may be."""
    frame = np.linalg.svd(u[None])[2]  # rows u, and two across it
    p = points @ frame.T
    middle = (p.min(axis=0) + p.max(axis=0)) / 2
    square = ((p - middle)[:, 1:] ** 2).sum(axis=1)
    radius = float(np.sqrt(square.max()))
    room = np.sqrt(np.maximum(radius**2 - square, 0.0))
    low, high = float((p[:, 0] + room).min()), float((p[:, 0] - room).max())
    low, high = (low, high) if low <= high else ((low + high) / 2,) * 2
    start, end = (np.array([x, *middle[1:]]) @ frame for x in (low, high))
    return _capsule(link, start, end, radius)


def _volume(capsule: Capsule) -> float:
    length = float(np.linalg.norm(np.subtract(capsule.end, capsule.start)))
    return float(np.pi * capsule.radius**2 * (length + 4 / 3 * capsule.radius))


def _capsule(link: int, start: np.ndarray, end: np.ndarray, radius: float) -> Capsule:
    (a, b, c), (x, y, z) = start.tolist(), end.tolist()
    return Capsule(link, (a, b, c), (x, y, z), radius)
