"""What a jig is: rectangular faces at known places, and boxes to keep clear of."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from identify.model.shape import Shape


@dataclass(frozen=True, eq=False)
class Face:
    """The rectangle origin + s u + t v, 0 <= s, t <= 1, seen from outside along u x v, in the jig frame."""

    name: str
    origin: Float[np.ndarray, " 3"]  # [mm]
    u: Float[np.ndarray, " 3"]  # [mm]
    v: Float[np.ndarray, " 3"]  # [mm]
    tolerance: float = 0.0  # [mm], 1 sigma of the machining
    tilt: float = field(
        default=0.0, metadata={"key": "tolerance_deg"}
    )  # [rad], 1 sigma of its lean along u and along v

    @cached_property
    def normal(self) -> Float[np.ndarray, " 3"]:
        """Outward unit normal."""
        n = np.cross(self.u, self.v)
        return n / np.linalg.norm(n)

    @cached_property
    def offset(self) -> float:
        """Distance of the plane from the origin of the jig frame along the normal [mm]."""
        return float(self.normal @ self.origin)

    @cached_property
    def size(self) -> Float[np.ndarray, " 2"]:
        """Lengths of u and v [mm]."""
        return np.linalg.norm([self.u, self.v], axis=1)

    def point(self, s: Float[np.ndarray, "..."], t: Float[np.ndarray, "..."]) -> Float[np.ndarray, "... 3"]:
        """Points of the rectangle at fractions s of u and t of v [mm]."""
        return self.origin + s[..., None] * self.u + t[..., None] * self.v

    def fractions(self, point: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 2"]:
        """Fractions (s, t) of points projected on the plane of the face; on the rectangle where both lie in 0 ... 1."""
        return np.asarray((point - self.origin) @ np.linalg.pinv(np.stack([self.u, self.v])))

    def beside(self, point: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "..."]:
        """How far [mm] points lie beside the rectangle in its plane, along u or along v; 0 on it."""
        fractions = self.fractions(point)
        return np.asarray((np.maximum(np.maximum(-fractions, fractions - 1), 0.0) * self.size).max(axis=-1))


@dataclass(frozen=True)
class Box:
    """A solid block along the axes of the jig frame, to keep clear of."""

    lower: tuple[float, float, float]  # [mm]
    upper: tuple[float, float, float]  # [mm]


@dataclass(frozen=True, eq=False)
class Jig:
    """A machined block with named faces."""

    name: str
    faces: tuple[Face, ...]
    boxes: tuple[Box, ...] = ()
    obstacles: tuple[Shape, ...] = ()  # solids that may lean; their poses are in the jig frame

    @cached_property
    def by_name(self) -> dict[str, Face]:
        """Faces by their names."""
        return {face.name: face for face in self.faces}

    @cached_property
    def corners(self) -> Float[np.ndarray, "corners 3"]:
        """The corners of all faces [mm]."""
        return np.concatenate([[f.origin, f.origin + f.u, f.origin + f.v, f.origin + f.u + f.v] for f in self.faces])
