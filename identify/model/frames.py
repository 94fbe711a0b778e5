"""Rigid transforms as 4 x 4 matrices, stacked along leading axes; R = Rz Ry Rx everywhere."""

import numpy as np
from jaxtyping import Float

Array = np.ndarray
Angles = float | Float[Array, "..."]  # [rad]


def rotation(rz: Angles, ry: Angles, rx: Angles) -> Float[Array, "... 3 3"]:
    """Rotation matrices Rz(rz) Ry(ry) Rx(rx) of angles in radians."""
    cz, sz, cy, sy, cx, sx = np.cos(rz), np.sin(rz), np.cos(ry), np.sin(ry), np.cos(rx), np.sin(rx)
    rows = [
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def euler(R: Float[Array, "... 3 3"]) -> Float[Array, "... 3"]:
    """Angles rz, ry, rx [rad] with R = Rz Ry Rx; rz carries the whole turn where ry is +-90 degrees."""
    cosine = np.hypot(R[..., 0, 0], R[..., 1, 0])
    locked = cosine < 1e-12
    rz = np.where(locked, np.arctan2(-R[..., 0, 1], R[..., 1, 1]), np.arctan2(R[..., 1, 0], R[..., 0, 0]))
    ry = np.arctan2(-R[..., 2, 0], cosine)
    # rx of Rz' R, not of R itself: near 90 degrees rz and rx are each uncertain, and only together exact
    c, s = np.cos(rz), np.sin(rz)
    turned = np.arctan2(s * R[..., 0, 2] - c * R[..., 1, 2], c * R[..., 1, 1] - s * R[..., 0, 1])
    rx = np.where(locked, 0.0, turned)
    return np.stack([rz, ry, rx], axis=-1)


def transform(pose: Float[Array, "... 6"]) -> Float[Array, "... 4 4"]:
    """Transforms of poses x, y, z [mm], rz, ry, rx [rad]: Trans(x, y, z) Rz Ry Rx (equations 2 and 5)."""
    T = np.zeros((*pose.shape[:-1], 4, 4))
    T[..., :3, :3] = rotation(pose[..., 3], pose[..., 4], pose[..., 5])
    T[..., :3, 3] = pose[..., :3]
    T[..., 3, 3] = 1.0
    return T


def pose(T: Float[Array, "... 4 4"]) -> Float[Array, "... 6"]:
    """Poses x, y, z [mm], rz, ry, rx [rad] of transforms; the inverse of `transform`."""
    return np.concatenate([T[..., :3, 3], euler(T[..., :3, :3])], axis=-1)


def inverse(T: Float[Array, "... 4 4"]) -> Float[Array, "... 4 4"]:
    """Inverses of rigid transforms."""
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    out = np.zeros_like(T)
    out[..., :3, :3] = Rt
    out[..., :3, 3] = -(Rt @ T[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def nearest_rotation(M: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """The rotation closest to M in the Frobenius norm (Schoenemann 1966)."""
    U, _, Vt = np.linalg.svd(M)
    return U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
