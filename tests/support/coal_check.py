"""A judge of ways that shares nothing with the driver: solids by coal, kinematics by equations 2 to 4."""

from functools import cached_property

import coal
import numpy as np

from identify.model.cell import Cell
from identify.model.frames import transform
from identify.model.jig import Face

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
        for _, solid, _ in out:
            solid.computeLocalAABB()
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
        out.append((last, *_capsule(p, p - BARE * w, 1e-3)))
        for _, geometry, _ in out:
            geometry.computeLocalAABB()
        return out

    def frames(self, q: np.ndarray) -> list[np.ndarray]:
        """Frames of the links in the jig frame, one for each posture (equations 2 to 4)."""
        T = np.tile(transform(self.theta[:6]) @ self.cell.robot.base_T_first, (len(q), 1, 1))
        out = [T]
        for joint, value, link in zip(self.cell.robot.joints, q.T, self.theta[6:-6].reshape(-1, 5), strict=False):
            turn, d, a, alpha, beta = (np.full(len(q), x) for x in link)
            turn, d = (turn, d + value) if joint.prismatic else (turn + value, d)
            (ct, cl, cb), (st, sl, sb) = np.cos([turn, alpha, beta]), np.sin([turn, alpha, beta])
            none, one = np.zeros(len(q)), np.ones(len(q))
            Rz = np.array([[ct, -st, none], [st, ct, none], [none, none, one]]).transpose(2, 0, 1)
            Rx = np.array([[one, none, none], [none, cl, -sl], [none, sl, cl]]).transpose(2, 0, 1)
            Ry = np.array([[cb, none, sb], [none, one, none], [-sb, none, cb]]).transpose(2, 0, 1)
            A = np.tile(np.eye(4), (len(q), 1, 1))
            A[:, :3, :3] = Rz @ Rx @ Ry
            A[:, :3, 3] = (Rz @ np.stack([a, none, d], axis=1)[:, :, None])[:, :, 0]
            T = T @ A
            out.append(T)
        return out

    def touch(self, face: Face, q: np.ndarray, approach: np.ndarray) -> list[str]:
        """What is wrong with a touch: at its contact, and on its search."""
        cell, robot, looks = self.cell, self.cell.robot, np.linspace(0, 1, 6)
        tip = self.frames(q[None])[-1][0] @ robot.last_T_flange @ transform(self.theta[-6:])
        p, w = tip[:3, 3], tip[:3, 2]
        lean = np.arccos(np.clip(-w @ face.normal, -1, 1))
        gap = face.normal @ (p - face.origin) - cell.wire.ball - cell.wire.flat * np.sin(lean)
        place = [(p - face.origin) @ side / (side @ side) for side in (face.u, face.v)]
        wrong = {
            f"{gap:.4f} mm off its face": abs(gap) > 1e-3,
            "beside its face": min(place) < 0 or max(place) > 1,
            "leans too far": lean > cell.touch.max_tilt + 1e-6,
            "beyond the limits": (
                np.abs(np.clip([q, approach], robot.lower, robot.upper) - [q, approach]) > 1e-9
            ).any(),
        }
        search = approach + looks[:, None] * (q - approach)
        ways = {share: self.hit(search[[k]], wire=share < 1) for k, share in enumerate(looks.tolist())}
        met = [f"{hit} at {share}" for share, hit in ways.items() if hit]
        return [why for why, bad in wrong.items() if bad] + met

    def hit(self, q: np.ndarray, *, wire: bool = True) -> str:
        """The solid that the first of some postures hits which hits any, with its wire or without; or ''."""
        frames = self.frames(q)
        places = [frames[link] @ local for link, _, local in (self.moving if wire else self.moving[:-1])]
        near = [(n, i, k) for i, k in np.ndindex(len(places), len(self.standing)) for n in self._near(i, k, places[i])]
        for n, i, k in sorted(near):
            name, solid, where = self.standing[k]
            place = coal.Transform3s(places[i][n, :3, :3], places[i][n, :3, 3])
            self.result.clear()
            if coal.collide(self.moving[i][1], place, solid, where, self.request, self.result):
                return name
        return ""

    def _near(self, i: int, k: int, place: np.ndarray) -> list[int]:
        """Postures in which the ball around what moves meets the box around what stands."""
        geometry, (_, solid, where) = self.moving[i][1], self.standing[k]
        ball = place[:, :3, :3] @ geometry.aabb_center + place[:, :3, 3]
        p, box = (ball - where.getTranslation()) @ where.getRotation(), solid.aabb_local
        away = np.linalg.norm(p - np.clip(p, box.min_, box.max_), axis=1)
        return np.flatnonzero(away <= geometry.aabb_radius).tolist()

    def way(self, start: np.ndarray, end: np.ndarray, step: float = np.radians(0.7)) -> str:
        """What a straight way hits first."""
        count = int(np.ceil(np.abs(end - start).max() / step)) + 1
        return self.hit(start + np.linspace(0, 1, count)[:, None] * (end - start))


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
