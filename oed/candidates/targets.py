"""Contacts to ask for: corners, edges and insides of faces, the wire leaning all around and turning all around.

Of the touches of an optimal design nearly all sit at a corner of a face with the wire at the limit of its tilt, so most
targets do; the others fill the faces evenly.
"""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float, Int

from identify.model.cell import Cell
from identify.model.frames import rotation
from identify.model.jig import Face

CORNERS = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
EDGES = np.array([[0, 0.5], [1, 0.5], [0.5, 0], [0.5, 1], [0.5, 0.5]])  # and the middle
HAIR = 1e-6  # [rad] that the ring of steepest wires stays within the limit, for rounding
UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0])  # z of the tip points along the wire, into the face


@dataclass(frozen=True, eq=False)
class Targets:
    """Contacts to be reached: where on which face, and how the wire stands on it."""

    face: Int[np.ndarray, " targets"]
    point: Float[np.ndarray, "targets 3"]  # [mm], in the plane of the face
    normal: Float[np.ndarray, "targets 3"]
    tilt: Float[np.ndarray, " targets"]  # [rad]
    rotation: Float[np.ndarray, "targets 3 3"]  # jig_R_tip

    def __len__(self) -> int:
        return len(self.face)

    def take(self, index: Int[np.ndarray, " some"]) -> "Targets":
        """Some of the targets."""
        return Targets(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def followed_by(self, others: "Targets") -> "Targets":
        """These targets and then the others."""
        return Targets(
            **{f.name: np.concatenate([getattr(self, f.name), getattr(others, f.name)]) for f in fields(self)}
        )

    def tip(self, cell: Cell) -> Float[np.ndarray, "targets 3"]:
        """Where the middle of the wire's end is at contact [mm]."""
        return self.point + extent(cell, self.tilt)[:, None] * self.normal


def extent(cell: Cell, tilt: Float[np.ndarray, " touches"]) -> Float[np.ndarray, " touches"]:
    """How far the middle of the wire's end stays off a face at contact [mm]."""
    return cell.wire.ball + cell.wire.flat * np.sin(tilt)


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
    origin, u, v = (np.stack([getattr(f, key) for f in faces])[face] for key in ("origin", "u", "v"))
    point = origin + fraction[:, :1] * u + fraction[:, 1:] * v
    return Targets(face, point, normal, tilt, frame @ lean @ UPSIDE_DOWN)


def spread(cell: Cell, inset: Float[np.ndarray, "faces 2"], count: int, rng: np.random.Generator) -> Targets:
    """Contacts filling faces, tilts and turns evenly (additive recurrence, Roberts 2018); `inset` in fractions."""
    faces = cell.the_jig.faces
    x = (rng.random(5) + np.arange(count)[:, None] * _steps(5)) % 1
    face = rng.permutation(count) % len(faces)
    tilt = np.arccos(1 - x[:, 2] * (1 - np.cos(cell.touch.max_tilt - HAIR)))  # even over the cap of directions
    fraction = inset[face] + x[:, :2] * (1 - 2 * inset[face])
    return targets(faces, face, fraction, tilt, 2 * np.pi * x[:, 3], 2 * np.pi * x[:, 4])


def _steps(dimensions: int) -> Float[np.ndarray, " dimensions"]:
    """Powers of the inverse of the root of x^(d+1) = x + 1, the golden section's relatives."""
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (dimensions + 1))
    return root ** -np.arange(1.0, dimensions + 1)


def structured(cell: Cell, inset: Float[np.ndarray, "faces 2"], count: int, rng: np.random.Generator) -> Targets:
    """Contacts on a grid: corners, edges and middles of faces x leaning directions x turns; `inset` in fractions.

    Corners get a ring of the steepest wires, a ring inside of it and the upright wire; edges and middles the steepest
    ring. Rings and turns begin anywhere, so that further calls fill the gaps.
    """
    faces, steep = cell.the_jig.faces, cell.touch.max_tilt - HAIR
    k = max(4, round(np.sqrt(count / len(faces) / 6.5)))
    parts = [
        _ring(len(faces), CORNERS, k, k, (steep, steep), rng),
        _ring(len(faces), CORNERS, k // 2, k // 2, (0.0, steep), rng),
        _ring(len(faces), CORNERS, 1, k // 2, (0.0, 0.0), rng),
        _ring(len(faces), EDGES, k // 2, k // 2, (steep, steep), rng),
    ]
    face, place, tilt, azimuth, roll = (np.concatenate(column) for column in zip(*parts, strict=True))
    return targets(faces, face, inset[face] + place * (1 - 2 * inset[face]), tilt, azimuth, roll)


def _ring(
    faces: int,
    places: Float[np.ndarray, "places 2"],
    azimuths: int,
    rolls: int,
    tilt: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Face, place on it, tilt drawn between two values, azimuth and roll of a grid on every face."""
    shape = (faces, len(places), azimuths, rolls)
    face, place, i, j = (index.ravel() for index in np.indices(shape))
    azimuth = 2 * np.pi * (i + rng.random(shape[:2])[face, place]) / azimuths
    roll = 2 * np.pi * (j + rng.random(shape[:3])[face, place, i]) / rolls
    return face, places[place], rng.uniform(*tilt, face.size), azimuth, roll
