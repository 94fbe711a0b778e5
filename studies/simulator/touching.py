"""Touches of a robot by kinematics of their own: elementary motions in NumPy, one after the other."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.robot import Robot
from identify.model.touch import HIT, Plan, Touches

WAY = np.linspace(-3.0, 4.0, 141)  # of a search, in units of the way from the approach to the planned contact
HALVINGS = 30


def touched(
    cell: Cell,
    plan: Plan,
    theta: Float[np.ndarray, " parameters"],
    off: Mapping[str, float],
    rng: np.random.Generator,
    early: Float[np.ndarray, " touches"] | float = 0.0,
) -> Touches:
    """The touches of a robot that meet their faces, which stand `off` [mm] outside of their drawing.

    `early` [mm] is the distance before its face at which each search ends, below 0 beyond the face.
    """
    faces = [cell.the_jig.by_name[name] for name in plan.face]
    normal, offset = np.stack([f.normal for f in faces]), np.array([f.offset for f in faces])
    plane = offset + [off[name] for name in plan.face] + early
    plane = plane + cell.touch.sigma * rng.standard_normal(len(faces))

    def gap(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        p, R = tips(cell.robot, plan.approach + s[:, None] * (plan.q - plan.approach), theta)
        lean = (R[:, :, 2] * normal).sum(axis=1)
        extent = cell.wire.ball + cell.wire.flat * np.sqrt(np.maximum(1 - lean**2, 0.0))
        return (p * normal).sum(axis=1) - extent - plane, p

    gaps = np.stack([gap(np.full(len(faces), s))[0] for s in WAY])
    crosses = (gaps[:-1] > 0) & (gaps[1:] <= 0)
    first = crosses.argmax(axis=0)
    low, high = WAY[first], WAY[first + 1]
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        inside = gap(middle)[0] <= 0
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    at = np.array([face.fractions(p) for face, p in zip(faces, gap(high)[1], strict=True)])
    met = np.flatnonzero(crosses.any(axis=0) & ((at > 0) & (at < 1)).all(axis=1))
    blank, q = ("",) * len(faces), plan.approach + high[:, None] * (plan.q - plan.approach)
    return Touches(
        plan.ids,
        plan.face,
        q,
        normal,
        offset,
        np.full(len(faces), cell.touch.sigma),
        (HIT,) * len(faces),
        np.full(len(faces), np.nan),
        blank,
        blank,
        plan.approach,
    ).take(met)


def tips(
    robot: Robot, q: Float[np.ndarray, "poses joints"], theta: Float[np.ndarray, " parameters"]
) -> tuple[Float[np.ndarray, "poses 3"], Float[np.ndarray, "poses 3 3"]]:
    """Positions and rotations of the tip, by elementary motions one after the other (equations 1 to 5 of the paper)."""
    R, p = _turned(np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3)), theta[:6])
    R, p = R @ robot.base_T_first[:3, :3], p + R @ robot.base_T_first[:3, 3]
    for i, (turn, d, a, alpha, beta) in enumerate(theta[6 : 6 + 5 * len(robot.joints)].reshape(-1, 5)):
        slides = robot.joints[i].prismatic
        R = R @ _rotation(2, turn + (0.0 if slides else 1.0) * q[:, i])
        shift = np.stack([np.full(len(q), a), np.zeros(len(q)), d + (q[:, i] if slides else 0.0 * q[:, i])], axis=1)
        p = p + np.einsum("nij,nj->ni", R, shift)
        R = R @ _rotation(0, np.full(len(q), alpha)) @ _rotation(1, np.full(len(q), beta))
    R, p = R @ robot.last_T_flange[:3, :3], p + R @ robot.last_T_flange[:3, 3]
    R, p = _turned(R, p, theta[-6:])
    return p, R


def _turned(R: np.ndarray, p: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    p = p + R @ frame[:3]
    for axis_of, angle in zip((2, 1, 0), frame[3:], strict=True):
        R = R @ _rotation(axis_of, np.full(len(R), angle))
    return R, p


def _rotation(about: int, angle: Float[np.ndarray, " poses"]) -> Float[np.ndarray, "poses 3 3"]:
    out, i, j = np.zeros((len(angle), 3, 3)), (about + 1) % 3, (about + 2) % 3
    out[:, about, about] = 1.0
    out[:, i, i] = out[:, j, j] = np.cos(angle)
    out[:, j, i], out[:, i, j] = np.sin(angle), -np.sin(angle)
    return out
