"""Rectangular faces of a part from the triangles of its mesh: planar, free in front, in reach of a wire from above."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from identify.model.jig import Face

SAME = 1e-3  # [mm] that vertices of one corner, or of one plane, may differ; single precision of an STL
PARALLEL = 1e-4  # [rad] between the normals of triangles in one plane
SMALLEST = 10.0  # [mm], the sides of a face that is worth a touch
FREE = 40.0  # [mm] in front of a face for the wire, or the face counts as covered
DOWN = -0.2  # least height of a normal: a wire comes from above, or from the side
LINES = 40  # of a grid over one facet, at most

Mesh = tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "triangles 3"]]


@dataclass(frozen=True, eq=False)
class Facet:
    """Triangles that share edges and lie in one plane."""

    corners: Float[np.ndarray, "triangles 3 3"]  # [mm]
    normal: Float[np.ndarray, " 3"]

    @property
    def points(self) -> Float[np.ndarray, "points 3"]:
        """All corners of its triangles."""
        return self.corners.reshape(-1, 3)

    def axes(self) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """Directions u and v in the plane, u x v along the normal: u along an axis of the jig where it can be."""
        ends = np.concatenate([self.corners[:, [i, (i + 1) % 3]] for i in range(3)])
        keys = [frozenset(map(tuple, pair)) for pair in np.round(ends / SAME).tolist()]
        count = Counter(keys)
        outer = np.array([count[key] == 1 for key in keys])  # those inside belong to two triangles
        edges = (ends[:, 1] - ends[:, 0])[outer]
        length = np.linalg.norm(edges, axis=1)
        square = [u for u in np.eye(3) if abs(u @ self.normal) < PARALLEL]
        along = edges[length > SAME] / length[length > SAME, None]
        u = next((u for u in square if np.abs(along @ u).max() > 1 - PARALLEL), edges[length.argmax()])
        u = u / np.linalg.norm(u)
        return u, np.cross(self.normal, u)


def faces_of(mesh: Mesh) -> tuple[Face, ...]:
    """The rectangles of a part on which touches can land, each named by its side and by where its middle is [mm]."""
    vertices, triangles = _welded(*mesh)
    corners = vertices[triangles]
    faces = list[Face]()
    for facet in _facets(vertices, triangles):
        if facet.normal[2] >= DOWN:
            faces += _rectangles(facet, vertices, corners)
    names = _names(faces)
    order = np.lexsort([[f.point(np.array(0.5), np.array(0.5))[k] for f in faces] for k in (1, 0, 2)])[::-1]
    return tuple(Face(names[i], faces[i].origin, faces[i].u, faces[i].v) for i in order.tolist())


def _welded(vertices: np.ndarray, triangles: np.ndarray) -> Mesh:
    """A mesh whose equal vertices are one, without triangles of no area."""
    _, first, place = np.unique(
        np.round(vertices / SAME).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    triangles = place.ravel()[triangles]
    corners = vertices[first][triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return vertices[first], triangles[area > SAME**2]


def _facets(vertices: np.ndarray, triangles: np.ndarray) -> list[Facet]:
    """Triangles joined over shared edges, where both lie in one plane."""
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    owner = np.tile(np.arange(len(triangles)), 3)
    edge = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    order = np.lexsort(edge.T)
    same = (edge[order][1:] == edge[order][:-1]).all(axis=1)
    a, b = owner[order][:-1][same], owner[order][1:][same]
    flat = (normal[a] * normal[b]).sum(axis=1) > np.cos(PARALLEL)
    graph = coo_array((np.ones(flat.sum()), (a[flat], b[flat])), shape=(len(triangles),) * 2)
    group = connected_components(graph, directed=False)[1]
    return [
        Facet(corners[group == g], normal[int(np.argmax(group == g))]) for g in range(int(group.max(initial=-1)) + 1)
    ]


def _rectangles(facet: Facet, vertices: np.ndarray, corners: np.ndarray) -> list[Face]:
    """The largest free rectangles of a facet along its axes; overlapping ones, where it is no rectangle itself."""
    u, v = facet.axes()
    plane = np.abs((vertices - facet.points[0]) @ facet.normal) < SAME
    lines = [_lines(facet.points @ axis, vertices[plane] @ axis) for axis in (u, v)]
    if any(len(line) > LINES or np.ptp(line) < SMALLEST for line in lines):
        return []
    free = _free(facet, corners, u, v, lines)
    out = []
    for i, k, m, n in _maximal(free):
        size = lines[0][k] - lines[0][i], lines[1][n] - lines[1][m]
        if min(size) >= SMALLEST:
            height = float(facet.points[0] @ facet.normal)
            out.append(Face("", lines[0][i] * u + lines[1][m] * v + height * facet.normal, size[0] * u, size[1] * v))
    return out


def _lines(own: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Places of grid lines: the corners of a facet, and those of others within it."""
    inside = others[(others > own.min() + SAME) & (others < own.max() - SAME)]
    places = np.sort(np.concatenate([own, inside]))
    return places[np.concatenate([[True], np.diff(places) > SAME])]


def _free(
    facet: Facet, corners: np.ndarray, u: np.ndarray, v: np.ndarray, lines: list[np.ndarray]
) -> Bool[np.ndarray, "a b"]:
    """Cells of a grid that lie on the facet with nothing in front of them."""
    height = float(facet.points[0] @ facet.normal)
    share = np.array([0.02, 0.5, 0.98])
    a, b = (line[:-1, None] + share * np.diff(line)[:, None] for line in lines)
    shape = len(a), len(b)
    s, t = np.broadcast_arrays(a[:, None, :, None], b[None, :, None, :])
    p = s.reshape(-1, 1) * u + t.reshape(-1, 1) * v + height * facet.normal
    on = _distance_along(p - facet.normal, facet.normal, facet.corners)[0] < 2
    away, back = _distance_along(p + SAME * facet.normal, facet.normal, corners)
    good = on & ~back & (away > FREE)  # the first facet ahead is seen from its front, and far enough
    return np.asarray(good.reshape(*shape, 9).all(axis=2))


def _distance_along(
    p: Float[np.ndarray, "rays 3"], along: Float[np.ndarray, " 3"], corners: Float[np.ndarray, "triangles 3 3"]
) -> tuple[Float[np.ndarray, " rays"], Bool[np.ndarray, " rays"]]:
    """Distances to the first triangle that each ray meets (inf: none), and whether it meets its back (Moller 1997)."""
    a, e, f = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    h = np.cross(along, f)
    det = (e * h).sum(axis=1)
    some = np.abs(det) > 1e-9 * np.linalg.norm(e, axis=1) * np.linalg.norm(f, axis=1)
    a, e, f, h, det = a[some], e[some], f[some], h[some], det[some]
    away, back = np.full(len(p), np.inf), np.zeros(len(p), dtype=bool)
    for i, one in enumerate(p):
        s = one - a
        x = (s * h).sum(axis=1) / det
        q = np.cross(s, e)
        y = (q @ along) / det
        d = (f * q).sum(axis=1) / det
        met = np.flatnonzero((x >= -1e-9) & (y >= -1e-9) & (x + y <= 1 + 1e-9) & (d > 0))
        if len(met):
            first = met[np.argmin(d[met])]
            away[i], back[i] = d[first], det[first] < 0
    return away, back


def _maximal(free: Bool[np.ndarray, "a b"]) -> list[tuple[int, int, int, int]]:
    """All rectangles of free cells that no larger one holds, as ranges of lines, the largest first."""
    total = np.pad(free.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    rectangles = list[tuple[int, int, int, int]]()
    a = len(free)
    for i in range(a):
        for k in range(a, i, -1):
            full = (total[k, 1:] - total[i, 1:] - total[k, :-1] + total[i, :-1]) == k - i
            ends = np.flatnonzero(np.diff(np.concatenate([[0], full.astype(int), [0]])))
            for m, n in ends.reshape(-1, 2).tolist():
                if not any(x <= i and k <= y and s <= m and n <= t for x, y, s, t in rectangles):
                    rectangles.append((i, k, m, n))
    return rectangles


def _names(faces: list[Face]) -> list[str]:
    """Side and middle of each face, such as top-200-150-60."""
    out = list[str]()
    for face in faces:
        x, y, z = (round(value) for value in face.point(np.array(0.5), np.array(0.5)).tolist())
        nx, ny, nz = face.normal.tolist()
        if abs(nz) > 1 - PARALLEL:
            side = "top"
        elif max(abs(nx), abs(ny)) > 1 - PARALLEL:
            side = ("right" if nx > 0 else "left") if abs(nx) > abs(ny) else ("front" if ny > 0 else "back")
        else:
            side = "slope"
        name = f"{side}_{x}_{y}_{z}"
        out.append(name if name not in out else f"{name}_{len(out)}")
    return out
