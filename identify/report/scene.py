"""What the 3-D view shows, as plain data: jig, zone, touches, and the robot at each of them."""

from base64 import b64encode
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from identify.model.cell import Cell
from identify.model.meshes import READERS
from identify.model.robot import Robot
from identify.model.shape import Shape

MOST = 300  # touches that can be stepped through: the page stays small
TRIANGLES = 1200  # of a link, about
FINEST = 4.0  # [mm], grid on which vertices are merged
UNIT = 0.1  # [mm], of the numbers that meshes are written in

Mesh = tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "triangles 3"]]


def scene(
    cell: Cell,
    theta: Float[np.ndarray, " parameters"] | None,
    ids: tuple[str, ...],
    faces: tuple[str | None, ...],
    q: Float[np.ndarray, "touches joints"],
    words: tuple[str, ...],
) -> dict[str, Any]:
    """Everything in the jig frame [mm]; `theta` is the identified robot, None where there is only the nominal one.

    The face of a posture that touches nothing is None; of a touch on a plane it is empty.
    """
    jig, zone = cell.jig, cell.zone
    q = q[:MOST]
    nominal = _skeletons(cell, cell.theta, q)
    identified = None if theta is None else _skeletons(cell, theta, q)
    links = _links(cell.robot)
    frames = _frames(cell, cell.theta if theta is None else theta, q) if links else None
    return {
        "faces": [
            {"name": f.name, "origin": f.origin.tolist(), "u": f.u.tolist(), "v": f.v.tolist()}
            for f in (jig.faces if jig else ())
        ],
        "boxes": [{"lower": b.lower, "upper": b.upper} for b in (jig.boxes if jig else ())],
        "shapes": [_solid(shape) for shape in (*(jig.obstacles if jig else ()), *cell.obstacles)],
        "zone": None if zone is None else {"lower": zone.box[:, 0].tolist(), "upper": zone.box[:, 1].tolist()},
        "unit": UNIT,
        "links": links,
        "touches": [
            {"id": ids[i], "face": faces[i], "words": words[i], "nominal": nominal[i].tolist()}
            | ({} if identified is None else {"identified": identified[i].tolist()})
            | ({} if frames is None else {"frames": frames[i].tolist()})
            for i in range(len(nominal))
        ],
        "left": max(0, len(ids) - len(nominal)),
    }


def _skeletons(
    cell: Cell, theta: Float[np.ndarray, " parameters"], q: Float[np.ndarray, "touches joints"]
) -> Float[np.ndarray, "touches points 3"]:
    """Origins of the link frames, the neck of the torch and the tip, to a tenth of a millimetre."""
    if not len(q):
        return np.empty((0, len(cell.robot.joints) + 2, 3))
    frames = cell.kinematics.links(q, theta)
    tip, R = cell.kinematics.tip(q, theta)
    neck = [tip - cell.neck * R[:, :, 2]] if cell.neck else []
    return np.stack([*(T[:, :, 3] for T in frames), *neck, tip], axis=1).round(1)


def _frames(
    cell: Cell, theta: Float[np.ndarray, " parameters"], q: Float[np.ndarray, "touches joints"]
) -> Float[np.ndarray, "touches numbers"]:
    """Seven numbers a link frame: its origin [mm] and its quaternion (x, y, z, w)."""
    if not len(q):
        return np.empty((0, 0))
    from scipy.spatial.transform import Rotation  # half a second, and only robots with meshes need it

    turns = [Rotation.from_matrix(T[:, :, :3]).as_quat().round(5) for T in cell.kinematics.links(q, theta)]
    origins = [T[:, :, 3].round(1) for T in cell.kinematics.links(q, theta)]
    return np.hstack([column for pair in zip(origins, turns, strict=True) for column in pair])


def _solid(shape: Shape) -> dict[str, Any]:
    """A solid that stands still: a mesh in the jig frame, or what it is, how large, and where it stands."""
    if shape.kind == "mesh":
        return {"kind": "mesh"} | _drawn(*shape.mesh)
    return {"kind": shape.kind, "size": list(shape.size), "pose": shape.pose.ravel().round(5).tolist()}


def _drawn(vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]) -> dict[str, str]:
    """A mesh, merged on a grid until it is small."""
    vertices, triangles = simplified(vertices, triangles)
    return {"vertices": _text(vertices / UNIT, "<i2"), "triangles": _text(triangles, "<u2")}


def _links(robot: Robot) -> list[dict[str, Any]]:
    """The meshes of the links."""
    links = []
    for number in sorted({shape.link for shape in robot.shapes if _drawable(shape.kind, shape.path)}):
        meshes = [s.mesh for s in robot.shapes if s.link == number and _drawable(s.kind, s.path)]
        links.append({"link": number} | _drawn(*joined_mesh(meshes)))
    return links


def _drawable(kind: str, path: Path | None) -> bool:
    return kind == "mesh" and path is not None and path.suffix.lower() in READERS


def joined_mesh(meshes: list[Mesh]) -> Mesh:
    """The vertices and triangles of several meshes as one."""
    first = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    return (
        np.concatenate([vertices for vertices, _ in meshes]),
        np.concatenate([triangles + k for (_, triangles), k in zip(meshes, first[:-1], strict=True)]),
    )


def simplified(vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]) -> Mesh:
    """A mesh of about TRIANGLES triangles: vertex clustering (Rossignac and Borrel 1993) on a grid that grows."""
    size = FINEST
    while True:
        _, first, place = np.unique(np.round(vertices / size), axis=0, return_index=True, return_inverse=True)
        merged = place.ravel()[triangles]
        solid = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 0] != merged[:, 2])
        merged = np.unique(merged[solid], axis=0)
        if len(merged) <= TRIANGLES:
            return vertices[first], merged
        size *= 1.3


def _text(numbers: np.ndarray, kind: str) -> str:
    """Numbers as base64 text."""
    return b64encode(np.round(numbers).astype(kind).tobytes()).decode()
