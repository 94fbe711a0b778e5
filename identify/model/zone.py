"""The weld zone: the poses where accuracy counts."""

from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from identify.model.cell import Cell, Zone
from identify.model.files import InputError
from identify.model.ik import reach

POSES = 300
ROUNDS = 20  # of drawing, before the zone is called out of reach


def zone_of(cell: Cell) -> Zone:
    """The weld zone of a cell; where none is given, the box around the jig, with the tilt that touches may have."""
    if cell.zone is not None:
        return cell.zone
    if cell.jig is None:
        raise InputError("the cell has neither a zone nor a jig; write zone: {box_mm: ..., max_tilt_deg: ...}")
    corners = cell.jig.corners
    return Zone(np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1), cell.touch.max_tilt)


def zone_poses(
    cell: Cell,
    theta: Float[np.ndarray, " parameters"] | None = None,
    poses: int = POSES,
    *,
    rng: np.random.Generator | None = None,
) -> Float[np.ndarray, "poses joints"]:
    """Joint values of poses spread over the weld zone [rad] or [mm], the same ones each time if no `rng` is given.

    Tip uniform in the box, torch axis uniform in the cone around straight down, any turn about it, any branch of the
    inverse kinematics; a robot of less than six joints stands in its own way. Raises InputError where it reaches none.
    """
    theta = cell.theta if theta is None else theta
    if rng is None:
        return _usual_poses(cell, theta.tobytes(), poses).copy()
    zone, robot = zone_of(cell), cell.robot
    postures = np.empty((0, len(robot.joints)))
    for _ in range(ROUNDS):
        m = 2 * poses
        position = rng.uniform(zone.box[:, 0], zone.box[:, 1], (m, 3))
        axis = cone(np.tile([0.0, 0.0, -1.0], (m, 1)), zone.max_tilt, rng.random((m, 2)))
        start = rng.uniform(robot.lower, robot.upper, (m, len(robot.joints)))
        result = reach(
            cell.kinematics,
            theta,
            position,
            frames(axis, 2 * np.pi * rng.random(m)),
            start,
            free_roll=len(robot.joints) == 5,
            free_orientation=len(robot.joints) < 5,
        )
        good = result.q[result.reached()]
        postures = np.concatenate([postures, good[in_zone(cell, good, theta)]])
        if len(postures) >= poses:
            return postures[:poses]
    if len(postures):
        return postures
    raise InputError(
        f"robot '{robot.name}' reaches no pose of the weld zone {np.round(zone.box).tolist()} mm within "
        f"{np.degrees(zone.max_tilt):.0f} degrees of straight down; is the base where cell.yaml says?"
    )


@lru_cache(maxsize=8)
def _usual_poses(cell: Cell, theta: bytes, poses: int) -> Float[np.ndarray, "poses joints"]:
    return zone_poses(cell, np.frombuffer(theta), poses, rng=np.random.default_rng(20))


def in_zone(
    cell: Cell, q: Float[np.ndarray, "poses joints"], theta: Float[np.ndarray, " parameters"] | None = None
) -> Bool[np.ndarray, " poses"]:
    """Poses whose tip lies in the box of the zone and whose torch is near enough to straight down."""
    zone = zone_of(cell)
    tip, R = cell.kinematics.tip(q, cell.theta if theta is None else theta)
    inside = ((tip >= zone.box[:, 0] - 1e-6) & (tip <= zone.box[:, 1] + 1e-6)).all(axis=1)
    return inside & (-R[:, 2, 2] >= np.cos(zone.max_tilt) - 1e-9)


def cone(
    middle: Float[np.ndarray, "rows 3"], tilt: float, uniform: Float[np.ndarray, "rows 2"]
) -> Float[np.ndarray, "rows 3"]:
    """Unit vectors uniform on the cap within `tilt` [rad] of directions, from uniform numbers in the unit square."""
    cosine = 1 - uniform[:, 0] * (1 - np.cos(tilt))
    sine = np.sqrt(np.maximum(0.0, 1 - cosine**2))
    phi = 2 * np.pi * uniform[:, 1]
    local = np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=1)
    return (frames(middle, np.zeros(len(middle))) @ local[..., None])[..., 0]


def frames(z: Float[np.ndarray, "rows 3"], roll: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "rows 3 3"]:
    """Rotation matrices whose third column is z, turned about it by `roll` [rad]."""
    helper = np.where(np.abs(z[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(z, x)
    c, s = (
        np.cos(roll)[..., None] if np.ndim(roll) else np.cos(roll),
        np.sin(roll)[..., None] if np.ndim(roll) else np.sin(roll),
    )
    return np.stack([c * x + s * y, c * y - s * x, z], axis=2)
