"""The touches that could be made: contact points on faces, wire and roll, joint values of contact and of approach."""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.frames import rotation
from identify.model.inverse import reach
from identify.model.jig import Face
from identify.model.measurement import Rows

TOLERANCE = 1e-4  # [mm], how well inverse kinematics has to meet a target


@dataclass(frozen=True, eq=False)
class Candidates:
    """Feasible touches, columns of equal length; `faces` are the faces of the jig that `face` counts through."""

    faces: tuple[Face, ...]
    face: Int[np.ndarray, " touches"]  # index into `faces`
    point: Float[np.ndarray, "touches 3"]  # [mm], below the middle of the wire's end, in the plane of the face
    normal: Float[np.ndarray, "touches 3"]  # outward
    tilt: Float[np.ndarray, " touches"]  # [rad], between the wire and the normal
    q: Float[np.ndarray, "touches joints"]  # [rad] or [mm], at contact
    approach: Float[np.ndarray, "touches joints"]  # [rad] or [mm]

    def __len__(self) -> int:
        return len(self.face)

    def take(self, index: Int[np.ndarray, " some"] | Bool[np.ndarray, " touches"]) -> "Candidates":
        """Some of the candidates, in the order of the index."""
        columns = {f.name: getattr(self, f.name)[index] for f in fields(self) if f.name != "faces"}
        return replace(self, **columns)

    def names(self) -> tuple[str, ...]:
        """The name of the face of every touch."""
        return tuple(self.faces[i].name for i in self.face)

    def rows(self, cell: Cell) -> Rows:
        """The equations that these touches will give, weighted by the scatter of touches and by the faces' tolerances."""
        wire, m = cell.wire, len(self)
        tolerance = np.array([face.tolerance for face in self.faces])[self.face]
        offset = np.array([face.offset for face in self.faces])[self.face]
        return Rows(
            self.q, self.normal, offset + (wire.radius if wire.shape == "ball" else 0.0),
            np.full(m, wire.radius if wire.shape == "flat" else 0.0), np.hypot(cell.touch.sigma, tolerance),
            tuple(str(i) for i in range(m)), np.arange(m),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Targets:
    """Contacts to be reached: where on which face, and how the wire stands on it."""

    face: Int[np.ndarray, " targets"]
    point: Float[np.ndarray, "targets 3"]  # [mm], in the plane of the face
    normal: Float[np.ndarray, "targets 3"]
    tilt: Float[np.ndarray, " targets"]  # [rad]
    rotation: Float[np.ndarray, "targets 3 3"]  # jig_R_tip


def targets(
    faces: tuple[Face, ...],
    face: Int[np.ndarray, " targets"],
    fraction: Float[np.ndarray, "targets 2"],
    tilt: Float[np.ndarray, " targets"],
    azimuth: Float[np.ndarray, " targets"],
    roll: Float[np.ndarray, " targets"],
) -> Targets:
    """Contacts at fractions of u and v of faces; the wire leans by `tilt` towards `azimuth`, from u to v [rad]."""
    normal = np.stack([f.normal for f in faces])[face]
    frame = np.stack([np.column_stack([f.u / f.size[0], f.v / f.size[1], f.normal]) for f in faces])[face]
    zero = np.zeros(len(face))
    lean = rotation(azimuth, tilt, zero) @ rotation(roll - azimuth, zero, zero)  # of the normal
    upside_down = np.diag([1.0, -1.0, -1.0])  # z of the tip points along the wire, into the face
    origin, u, v = (np.stack([getattr(f, key) for f in faces])[face] for key in ("origin", "u", "v"))
    point = origin + fraction[:, :1] * u + fraction[:, 1:] * v
    return Targets(face, point, normal, tilt, frame @ lean @ upside_down)


def extent(cell: Cell, tilt: Float[np.ndarray, " touches"]) -> Float[np.ndarray, " touches"]:
    """How far the middle of the wire's end stays off a face at contact [mm]."""
    wire = cell.wire
    if wire.shape == "flat":
        return wire.radius * np.sin(tilt)
    return np.full(len(tilt), wire.radius if wire.shape == "ball" else 0.0)


def candidates(cell: Cell, rng: np.random.Generator, count: int = 2000, *, inset: float = 0.2) -> Candidates:
    """At least `count` feasible touches where so many can be found: on all faces, within tilt and joint limits."""
    assert cell.jig is not None
    faces = cell.jig.faces
    found: list[Candidates] = []
    for _ in range(20):
        m = 2 * count
        drawn = targets(
            faces, rng.integers(len(faces), size=m), rng.uniform(inset, 1 - inset, (m, 2)),
            cell.touch.max_tilt * np.sqrt(rng.uniform(size=m)), *rng.uniform(-np.pi, np.pi, (2, m)),
        )  # fmt: skip
        found.append(_reached(cell, faces, drawn, rng))
        if sum(map(len, found)) >= count:
            break
    joined = {f.name: np.concatenate([getattr(c, f.name) for c in found]) for f in fields(Candidates)[1:]}
    return Candidates(faces, **joined).take(np.arange(min(count, len(joined["face"]))))


def _reached(cell: Cell, faces: tuple[Face, ...], wanted: Targets, rng: np.random.Generator) -> Candidates:
    robot, m = cell.robot, len(wanted.face)
    start = rng.uniform(robot.lower, robot.upper, (m, len(robot.joints)))
    tip = wanted.point + extent(cell, wanted.tilt)[:, None] * wanted.normal
    contact = reach(cell.kinematics, cell.theta, tip, wanted.rotation, start)
    above = tip + cell.touch.approach * wanted.normal
    approach = reach(cell.kinematics, cell.theta, above, wanted.rotation, contact.q)
    near = np.abs(approach.q - contact.q).max(axis=1) < 0.5
    ok = np.flatnonzero(contact.reached(TOLERANCE) & approach.reached(TOLERANCE) & near)
    return Candidates(
        faces, wanted.face[ok], wanted.point[ok], wanted.normal[ok], wanted.tilt[ok], contact.q[ok], approach.q[ok]
    )
