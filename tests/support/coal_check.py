"""A judge of ways that shares nothing with the driver: solids by coal, kinematics by equations 2 to 4."""

from functools import cached_property

import coal
import numpy as np

from identify.model.cell import Cell
from identify.model.frames import transform

BARE, NOZZLE, BODY, NECK, FLANGE = 18.0, 10.0, 20.0, 110.0, 30.0  # [mm], the torch as the manual draws it
ROUND = 0.36  # of the nozzle's radius, how far its round end stands back


class CoalCheck:
    """Arm, torch and bare wire of a robot among the solids of its cell."""

    def __init__(self, cell: Cell, theta: np.ndarray | None = None) -> None:
        self.cell, self.theta = cell, cell.theta if theta is None else theta
        self.request, self.result = coal.CollisionRequest(), coal.CollisionResult()

    @cached_property
    def standing(self) -> list[tuple[str, object, coal.Transform3s]]:
        jig = self.cell.jig
        out = []
        for i, box in enumerate(jig.boxes):
            low, high = np.array(box.lower), np.array(box.upper)
            out.append((f"box {i + 1}", coal.Box(*(high - low)), coal.Transform3s(np.eye(3), (low + high) / 2)))
        for shape in (*jig.obstacles, *self.cell.obstacles):
            T = np.eye(4) if shape.kind == "mesh" else shape.pose
            out.append((shape.name, _geometry(shape), coal.Transform3s(T[:3, :3], T[:3, 3])))
        return out

    @cached_property
    def moving(self) -> list[tuple[int, object, np.ndarray]]:
        """Link, geometry and where it stands on the link; the wire comes last."""
        robot, last = self.cell.robot, len(self.cell.robot.joints)
        out = [(s.link, _geometry(s), np.eye(4) if s.kind == "mesh" else s.pose) for s in robot.shapes if s.link]
        out += [(c.link, *_capsule(c.start, c.end, c.radius)) for c in robot.capsules if 0 < c.link < last]
        flange = robot.last_T_flange
        tip = flange @ transform(self.theta[-6:])
        p, w = tip[:3, 3], tip[:3, 2]
        neck = p - min(NECK, np.linalg.norm(p - flange[:3, 3]) / 2) * w
        body = neck - flange[:3, 3]
        out.append((last, *_capsule(p - (BARE + ROUND * NOZZLE) * w, neck, NOZZLE)))
        out.append((last, *_capsule(flange[:3, 3] + FLANGE * body / np.linalg.norm(body), neck, BODY)))
        return [*out, (last, *_capsule(p, p - BARE * w, 1e-3))]

    def frames(self, q: np.ndarray) -> list[np.ndarray]:
        """Frames of the links in the jig frame (equations 2 to 4)."""
        T = transform(self.theta[:6]) @ self.cell.robot.base_T_first
        out = [T]
        for joint, value, link in zip(self.cell.robot.joints, q, self.theta[6:-6].reshape(-1, 5), strict=False):
            turn, d, a, alpha, beta = link
            turn, d = (turn, d + value) if joint.prismatic else (turn + value, d)
            (ct, cl, cb), (st, sl, sb) = np.cos([turn, alpha, beta]), np.sin([turn, alpha, beta])
            Rz, Rx = np.array([[ct, -st, 0], [st, ct, 0], [0, 0, 1]]), np.array([[1, 0, 0], [0, cl, -sl], [0, sl, cl]])
            A = np.eye(4)
            A[:3, :3] = Rz @ Rx @ np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
            A[:3, 3] = Rz @ np.array([a, 0, d])
            T = T @ A
            out.append(T)
        return out

    def hit(self, q: np.ndarray) -> str:
        """The solid that a posture hits; empty where none."""
        frames = self.frames(q)
        for link, geometry, local in self.moving:
            T = frames[link] @ local
            place = coal.Transform3s(T[:3, :3], T[:3, 3])
            for name, solid, where in self.standing:
                self.result.clear()
                if coal.collide(geometry, place, solid, where, self.request, self.result):
                    return name
        return ""

    def way(self, start: np.ndarray, end: np.ndarray, step: float = np.radians(0.7)) -> str:
        """What a straight way hits."""
        count = int(np.ceil(np.abs(end - start).max() / step)) + 1
        return next((h for s in np.linspace(0, 1, count) if (h := self.hit(start + s * (end - start)))), "")


def _geometry(shape):
    if shape.kind == "box":
        return coal.Box(*shape.size)
    if shape.kind == "cylinder":
        return coal.Cylinder(*shape.size)
    if shape.kind == "sphere":
        return coal.Sphere(*shape.size)
    vertices, triangles = shape.mesh
    points, corners = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in vertices:
        points.append(vertex)
    for a, b, c in triangles.tolist():
        corners.append(coal.Triangle(a, b, c))
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(vertices))
    model.addSubModel(points, corners)
    model.endModel()
    return model


def _capsule(start, end, radius):
    a, b = np.array(start, dtype=float), np.array(end, dtype=float)
    z = (b - a) / np.linalg.norm(b - a)
    x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), (a + b) / 2
    return coal.Capsule(radius, float(np.linalg.norm(b - a))), T
