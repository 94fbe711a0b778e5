"""Orientations as programs write them, and of all ways to write one the nearest to what stood there."""

import numpy as np
from jaxtyping import Float

from identify.model.cell import DEG
from identify.model.frames import euler, rotation


def from_euler(angles: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Rz Ry Rx of rz, ry, rx [deg]."""
    rz, ry, rx = angles * DEG
    return rotation(rz, ry, rx)


def euler_near(R: Float[np.ndarray, "3 3"], old: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """Angles rz, ry, rx [deg] of R, of the two triples and their whole turns the nearest to an old triple.

    Turns that leave (-180, 180] are taken only where the old angle lay outside too.
    """
    first = euler(R) / DEG
    second = np.array([first[0] + 180, 180 - first[1], first[2] + 180])
    triples = [triple + 360 * np.round((old - triple) / 360) for triple in (first, second)]
    best = min(triples, key=lambda triple: float(np.abs(triple - old).max()))
    inside = best - 360 * np.ceil((best - 180) / 360)
    return np.where(np.abs(old) <= 180, inside, best)


def from_quaternion(q: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "3 3"]:
    """The rotation of a quaternion, scalar first, that rounding has left a little off its length of 1."""
    w, v = q[0] / np.linalg.norm(q), q[1:] / np.linalg.norm(q)
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def quaternion_near(R: Float[np.ndarray, "3 3"], old: Float[np.ndarray, " 4"]) -> Float[np.ndarray, " 4"]:
    """The quaternion of R, scalar first; of the two signs the nearer to an old one (Bar-Itzhack 2000)."""
    K = np.zeros((4, 4))
    K[0, 0], K[1:, 1:] = np.trace(R), R + R.T - np.trace(R) * np.eye(3)
    K[0, 1:] = K[1:, 0] = [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]
    q = np.linalg.eigh(K)[1][:, -1]
    return q if q @ old >= 0 else -q


def angle_between(A: Float[np.ndarray, "3 3"], B: Float[np.ndarray, "3 3"]) -> float:
    """The angle of the turn from A to B [deg]."""
    R = A.T @ B
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return float(np.arctan2(np.linalg.norm(v), (np.trace(R) - 1) / 2) / DEG)
