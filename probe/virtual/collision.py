"""What the arm and the torch of the virtual robot hit: balls along links and torch among the solids of the cell.

It shares nothing with the planner's and the driver's judgement, so that an error there shows here.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from identify.model.cell import Cell
from identify.model.frames import transform
from identify.model.robot import Robot
from identify.model.shape import Shape

BARE, NOZZLE, BODY = 18.0, 9.0, 19.0  # [mm] of bare wire; radii of nozzle and torch, a millimetre less than drawn
NECK, FLANGE = 110.0, 30.0  # [mm], from the tip back to the neck, and from the flange to where the torch begins
GROUP = 64  # balls of a link that are judged together
SPACING = 6.0  # [mm] between balls, and between points of a mesh
DEEP = 0.2  # [mm]: what is nearer grazes
STEP = 5.0  # [mm] of the arm's way between two looks
MOST = 256  # looks at one motion


@dataclass(frozen=True)
class Collision:
    """Two bodies that met, and where on the path."""

    fraction: float
    body: str
    other: str

    def __str__(self) -> str:
        return f"{self.body} has hit {self.other}"


@dataclass(frozen=True, eq=False)
class Balls:
    """Balls that move with one link."""

    link: int
    name: str
    centre: Float[np.ndarray, "balls 3"]  # [mm], in the frame of the link
    radius: float  # [mm], of each ball

    @cached_property
    def groups(self) -> Float[np.ndarray, "groups some 3"]:
        """The centres in groups of neighbours of one size: halves of halves, the last centre of a short one again."""
        groups = [self.centre]
        while len(groups[0]) > GROUP:
            widest = [np.ptp(group, axis=0).argmax() for group in groups]
            ordered = [group[np.argsort(group[:, axis])] for group, axis in zip(groups, widest, strict=True)]
            groups = [half for group in ordered for half in np.array_split(group, 2)]
        size = max(map(len, groups))
        return np.stack([group[np.arange(size).clip(max=len(group) - 1)] for group in groups])

    @cached_property
    def spheres(self) -> tuple[Float[np.ndarray, "groups 3"], Float[np.ndarray, " groups"]]:
        """Centre and radius of a sphere around the balls of each group [mm]."""
        middle = (self.groups.min(axis=1) + self.groups.max(axis=1)) / 2
        return middle, np.linalg.norm(self.groups - middle[:, None], axis=2).max(axis=1) + self.radius

    @cached_property
    def tree(self) -> Any:
        """The centres by where they are."""
        from scipy.spatial import KDTree

        return KDTree(self.centre)


class Surroundings:
    """A robot with its torch among the solids of a cell."""

    def __init__(self, cell: Cell, robot: Robot) -> None:
        self.cell, self.robot = cell, robot
        jig = cell.jig
        boxes = () if jig is None else jig.boxes
        self.boxes = [(f"box {i + 1}", np.array(box.lower), np.array(box.upper)) for i, box in enumerate(boxes)]
        self.shapes = (*(() if jig is None else jig.obstacles), *cell.obstacles)

    @cached_property
    def arm(self) -> list[Balls]:
        """The links, without the torch; the base may stand on the table."""
        last = len(self.robot.joints)
        bodies = [_along(c.link, f"link {c.link}", c.start, c.end, c.radius) for c in self.robot.capsules]
        return [balls for balls in (*bodies, *_shapes(self.robot)) if 0 < balls.link < last]

    def prepare(self) -> None:
        """Sample the surfaces of the links, which takes seconds for some meshes: before anybody waits for an answer."""
        if self.boxes or self.shapes:
            for balls in self.arm:
                _ = balls.spheres, balls.tree

    def torch(self, theta: Float[np.ndarray, " parameters"]) -> list[Balls]:
        """Nozzle and body behind the wire, where the tip truly is; a robot file's own last link in their place."""
        last = len(self.robot.joints)
        own = [_along(last, "the torch", c.start, c.end, c.radius) for c in self.robot.capsules if c.link == last]
        if own or self.cell.tool is None:
            return own
        tip = self.robot.last_T_flange @ transform(theta[-6:])
        end, wire, flange = tip[:3, 3], tip[:3, 2], self.robot.last_T_flange[:3, 3]
        reach = float(np.linalg.norm(end - flange))
        if reach < 2 * (BARE + NOZZLE + 1):
            return []
        neck = end - min(NECK, reach / 2) * wire
        out = [_along(last, "the torch", end - (BARE + NOZZLE / 2) * wire, neck, NOZZLE)]
        body = neck - flange
        if np.linalg.norm(body) >= FLANGE + BODY + 1:
            out.append(_along(last, "the torch", flange + FLANGE / np.linalg.norm(body) * body, neck, BODY))
        return out

    def first(self, q: Float[np.ndarray, "looks joints"], theta: Float[np.ndarray, " parameters"]) -> Collision | None:
        """The first of evenly spaced looks at a path at which something is hit, deeper than where the path begins."""
        if not (self.boxes or self.shapes):
            return None
        frames, torch = self._frames(q, theta), self.torch(theta)
        first: Collision | None = None
        for balls in (*self.arm, *torch):
            for name, gap in self._gaps(balls, frames[balls.link]):
                first = _earlier(first, gap, balls.name, name)
        for balls in torch:
            for other in self.arm:
                if other.link < balls.link - 2:
                    gap = _between(balls, other, frames[balls.link], frames[other.link])
                    first = _earlier(first, gap, balls.name, other.name)
        return first

    def _gaps(
        self, balls: Balls, T: Float[np.ndarray, "looks 4 4"]
    ) -> Iterator[tuple[str, Float[np.ndarray, " looks"]]]:
        """Distances of balls from every solid [mm], infinite where the sphere around them is clear of it."""
        (middle, reach), groups = balls.spheres, balls.groups
        middles = middle @ T[:, :3, :3].mT + T[:, None, :3, 3]
        solids = [(name, partial(_box, lower=low, upper=high), (low, high)) for name, low, high in self.boxes]
        solids += [(shape.name, partial(_distance, shape), _around(shape)) for shape in self.shapes]
        for name, distance, (lower, upper) in solids:
            look, group = np.nonzero(_box(middles, lower, upper) < reach)
            if len(look):
                gap = np.full(len(T), np.inf)
                p = groups[group] @ T[look, :3, :3].mT + T[look, None, :3, 3]
                np.minimum.at(gap, look, distance(p).min(axis=1) - balls.radius)
                yield name, gap

    def _frames(
        self, q: Float[np.ndarray, "looks joints"], theta: Float[np.ndarray, " parameters"]
    ) -> list[Float[np.ndarray, "looks 4 4"]]:
        """Frames of the links in the jig frame (equations 2 to 4), without what joint errors move them by."""
        T = np.broadcast_to(transform(theta[:6]) @ self.robot.base_T_first, (len(q), 4, 4))
        out = [T]
        for i, joint in enumerate(self.robot.joints):
            turn, d, a, alpha, beta = theta[6 + 5 * i : 11 + 5 * i]
            value = np.zeros((len(q), 6))
            value[:, 3] = turn if joint.prismatic else turn + q[:, i]
            slide = d + q[:, i] if joint.prismatic else np.full(len(q), d)
            A = transform(value)
            A[:, :3, 3] = a * A[:, :3, 0] + slide[:, None] * A[:, :3, 2]
            T = T @ A @ transform(np.array([0, 0, 0, 0, 0, alpha])) @ transform(np.array([0, 0, 0, 0, beta, 0]))
            out.append(T)
        return out


def _earlier(first: Collision | None, gap: Float[np.ndarray, " looks"], body: str, other: str) -> Collision | None:
    """The earlier of a collision and the first look at which a gap is closed, and more so than at the beginning."""
    hit = np.flatnonzero((gap < -DEEP) & (gap < gap[0] - DEEP)) if gap[0] < 0 else np.flatnonzero(gap < -DEEP)
    if not len(hit) or (first is not None and first.fraction <= hit[0] / (len(gap) - 1)):
        return first
    return Collision(float(hit[0] / (len(gap) - 1)), body, other)


def _along(link: int, name: str, start: object, end: object, radius: float) -> Balls:
    """Balls along a segment."""
    a, b = np.array(start, dtype=float), np.array(end, dtype=float)
    count = int(np.ceil(np.linalg.norm(b - a) / SPACING)) + 1
    centre = a + np.linspace(0, 1, count)[:, None] * (b - a)
    return Balls(link, name, centre, radius)


def _between(
    some: Balls, others: Balls, T: Float[np.ndarray, "looks 4 4"], U: Float[np.ndarray, "looks 4 4"]
) -> Float[np.ndarray, " looks"]:
    """Distances between balls that move with two links [mm], infinite where the spheres around them are apart."""
    gap = np.full(len(T), np.inf)
    (centres, reach), (middle, other_reach) = some.spheres, others.spheres
    middles = middle @ U[:, :3, :3].mT + U[:, None, :3, 3]
    low, high = (middles - other_reach[:, None]).min(axis=1), (middles + other_reach[:, None]).max(axis=1)
    apart = _box(centres @ T[:, :3, :3].mT + T[:, None, :3, 3], low[:, None], high[:, None]) - reach
    near = np.flatnonzero(apart.min(axis=1) < 0)
    p = some.centre @ T[near, :3, :3].mT + T[near, None, :3, 3]
    own = (p - U[near, None, :3, 3]) @ U[near, :3, :3]
    distance = others.tree.query(own.reshape(-1, 3))[0].reshape(own.shape[:-1])
    gap[near] = distance.min(axis=1) - some.radius - others.radius
    return gap


@lru_cache(maxsize=8)
def _shapes(robot: Robot) -> tuple[Balls, ...]:
    """Points on the surfaces of the shapes of a robot."""
    out = []
    for shape in robot.shapes:
        points = _surface(shape) if shape.readable else np.empty((0, 3))
        if len(points):
            out.append(Balls(shape.link, f"link '{shape.name}'", points, 0.0))
    return tuple(out)


def _surface(shape: Shape) -> Float[np.ndarray, "points 3"]:
    """Points on the surface of a shape, SPACING apart, in the frame of its link."""
    if shape.kind == "mesh":
        vertices, triangles = shape.mesh
        return _thinned(np.concatenate([vertices[np.unique(triangles)], *_inside(vertices[triangles])]))
    size = np.array(shape.size)
    half = {"box": size / 2, "cylinder": np.array([size[0], size[0], size[-1] / 2]), "sphere": np.full(3, size[0])}
    if shape.kind not in half:
        return np.empty((0, 3))
    edge = half[shape.kind]
    grid = np.stack(np.meshgrid(*(np.linspace(-1, 1, 9),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    grid = grid[np.abs(grid).max(axis=1) == 1]
    if shape.kind != "box":
        axes = 2 if shape.kind == "cylinder" else 3
        grid[:, :axes] /= np.maximum(np.linalg.norm(grid[:, :axes], axis=1, keepdims=True), 1.0)
    return (grid * edge) @ shape.pose[:3, :3].T + shape.pose[:3, 3]


def _inside(corners: Float[np.ndarray, "triangles 3 3"]) -> list[Float[np.ndarray, "points 3"]]:
    """Points inside triangles that are larger than SPACING."""
    long = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    out = []
    for corner, length in zip(corners[long > SPACING], long[long > SPACING], strict=True):
        n = min(int(np.ceil(length / SPACING)), 60)
        u, v = (x.ravel() / n for x in np.meshgrid(np.arange(n + 1), np.arange(n + 1)))
        u, v = u[u + v <= 1], v[u + v <= 1]
        out.append(corner[0] + u[:, None] * (corner[1] - corner[0]) + v[:, None] * (corner[2] - corner[0]))
    return out


def _thinned(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "fewer 3"]:
    """One point in every cube of SPACING."""
    cube: Int[np.ndarray, "points 3"] = np.floor(points / SPACING).astype(int)
    return points[np.unique(cube, axis=0, return_index=True)[1]]


def _box(p: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Distances of points from a box [mm], negative inside."""
    gap = np.maximum(lower - p, p - upper)
    return np.sqrt((np.maximum(gap, 0) ** 2).sum(axis=-1)) + np.minimum(gap.max(axis=-1), 0)


def _around(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """The corners of a box along the axes of the jig frame around a shape."""
    if shape.kind == "mesh":
        return shape.mesh[0].min(axis=0), shape.mesh[0].max(axis=0)
    reach = float(np.linalg.norm(shape.size))
    return shape.pose[:3, 3] - reach, shape.pose[:3, 3] + reach


def _distance(shape: Shape, p: np.ndarray) -> np.ndarray:
    """Distances of points from a solid [mm], negative inside; from a mesh, of its surface."""
    if shape.kind == "mesh":
        return _mesh_distance(shape, p)
    own = (p - shape.pose[:3, 3]) @ shape.pose[:3, :3]
    if shape.kind == "box":
        return _box(own, -np.array(shape.size) / 2, np.array(shape.size) / 2)
    if shape.kind == "sphere":
        return np.linalg.norm(own, axis=-1) - shape.size[0]
    radial = np.linalg.norm(own[..., :2], axis=-1) - shape.size[0]
    flat = np.stack([radial, np.abs(own[..., 2]) - shape.size[1] / 2], axis=-1)
    return np.sqrt((np.maximum(flat, 0) ** 2).sum(axis=-1)) + np.minimum(flat.max(axis=-1), 0)


def _mesh_distance(shape: Shape, p: np.ndarray) -> np.ndarray:
    """Distances of points from the nearest of points on the surface of a mesh [mm], to half of SPACING."""
    return np.asarray(_tree(shape).query(p.reshape(-1, 3))[0].reshape(p.shape[:-1]))


@lru_cache(maxsize=8)
def _tree(shape: Shape) -> Any:
    from scipy.spatial import KDTree

    return KDTree(_surface(shape))
