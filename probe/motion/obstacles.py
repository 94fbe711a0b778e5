"""What the robot must not hit: the boxes of the jig, or its faces where it has no boxes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from identify.model.jig import Face, Jig
from probe.motion.distances import Points, point_box, segment_box

PROBE = 1.0  # [mm] before and behind the middle of a face, to find the box that it belongs to


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A solid box along the axes of the jig frame, or of a frame of its own."""

    lower: Float[np.ndarray, " 3"]  # [mm], along its own axes
    upper: Float[np.ndarray, " 3"]
    axes: Float[np.ndarray, "3 3"] | None = None  # own_R_jig; None: those of the jig

    def seen(self, p: Points) -> Points:
        """Points along its own axes."""
        return p if self.axes is None else self.axes @ p

    def point(self, p: Points) -> Float[np.ndarray, " rows"]:
        """Distances of points [mm], 0 inside."""
        return point_box(self.seen(p), self.lower, self.upper)

    def segment(self, start: Points, end: Points) -> Float[np.ndarray, " rows"]:
        """Distances of segments [mm], 0 where they meet."""
        return segment_box(self.seen(start), self.seen(end), self.lower, self.upper)


def obstacles(jig: Jig) -> tuple[Obstacle, ...]:
    """The boxes of a jig; of a jig without boxes its faces, as plates: better than nothing, blind to what is inside."""
    if jig.boxes:
        return tuple(Obstacle(np.array(box.lower), np.array(box.upper)) for box in jig.boxes)
    return tuple(_plate(face) for face in jig.faces)


def _plate(face: Face) -> Obstacle:
    axes = np.stack([face.u / face.size[0], face.v / face.size[1], face.normal])
    corner = axes @ face.origin
    return Obstacle(corner, corner + np.array([*face.size, 0.0]), axes)


def owners(jig: Jig, solids: tuple[Obstacle, ...]) -> Bool[np.ndarray, "faces obstacles"]:
    """Whether a face lies on the surface of an obstacle: what a torch that touches it comes near of necessity."""
    middle = np.stack([face.point(np.array(0.5), np.array(0.5)) for face in jig.faces])
    normal = np.stack([face.normal for face in jig.faces])
    behind, before = (middle - PROBE * normal).T, (middle + PROBE * normal).T
    plates = not jig.boxes
    near = [(s.point(behind) <= PROBE * plates) & (s.point(before) > 0.5 * PROBE) for s in solids]
    return np.stack(near, axis=1) if near else np.zeros((len(jig.faces), 0), dtype=bool)
