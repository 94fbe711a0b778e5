"""Touches that a hidden robot makes on a workpiece at a hidden pose."""

from dataclasses import replace

import numpy as np

from identify.model.frames import inverse, pose, rotation, transform
from identify.model.ik import reach
from identify.model.io.calibration_file import Calibration
from identify.model.jig import Jig
from identify.model.touch import HIT, Touches
from identify.model.zone import cone, frames

TILT = 0.85  # [rad] between wire and normal, at most


def postures(calibration: Calibration, workpiece: Jig, base_T_workpiece, face, point, rng):
    """Joint values that bring the identified tip to points of faces, the wire leaning and turned anyhow."""
    cell, faces = calibration.cell, workpiece.by_name
    T = transform(calibration.theta[:6]) @ base_T_workpiece  # jig_T_workpiece
    normal = (T[:, :3, :3] @ np.stack([faces[name].normal for name in face])[..., None])[..., 0]
    position = (T[:, :3, :3] @ point[..., None])[..., 0] + T[:, :3, 3]
    q, todo = np.full((len(face), len(cell.robot.joints)), np.nan), np.arange(len(face))
    for _ in range(400):
        axis = np.concatenate([cone(-normal[[i]], TILT, rng.random((1, 2))) for i in todo])
        start = rng.uniform(cell.robot.lower, cell.robot.upper, (len(todo), q.shape[1]))
        R = frames(axis, 2 * np.pi * rng.random(len(todo)))
        found = reach(cell.kinematics, calibration.theta, position[todo], R, start)
        good = found.reached()
        q[todo[good]], todo = found.q[good], todo[~good]
        if not len(todo):
            return q
    raise AssertionError(f"{len(todo)} points are out of reach")


def latched(calibration, workpiece, base_T_workpiece, face, q, theta, rng, sigma, proud=None):
    """Joint values at which robots of parameters `theta` (one a touch) meet the faces, give or take `sigma` [mm]."""
    cell, faces = calibration.cell, workpiece.by_name
    n = np.stack([faces[name].normal for name in face])
    c = np.array([faces[name].offset for name in face]) + sigma * rng.standard_normal(len(face))
    c = c if proud is None else c + proud
    seen = np.array([pose(inverse(T)) for T in base_T_workpiece])  # the base from the workpiece
    theta = np.concatenate([seen, theta[:, 6:]], axis=1)
    for _ in range(4):
        p, R, J = cell.kinematics.pose_jacobian(q, theta)
        lean = (R[:, :, 2] * n).sum(axis=1)
        extent = cell.wire.radius * np.sqrt(1 - lean**2)
        slope = np.einsum("mi,mij->mj", n, J[:, :3])
        slope[:, 3:] = 0.0  # the wrist stays: its turns would change the extent
        q = q - slope * (((p * n).sum(axis=1) - c - extent) / (slope**2).sum(axis=1))[:, None]
    return q


def touches_of(workpiece: Jig, face, q, sigma, **changes) -> Touches:
    """Touches as they are read from touches.csv."""
    faces, m = workpiece.by_name, len(face)
    made = Touches(
        tuple(f"t{i + 1}" for i in range(m)),
        tuple(face),
        q,
        np.stack([faces[name].normal for name in face]),
        np.array([faces[name].offset for name in face]),
        np.full(m, sigma),
        (HIT,) * m,
        np.full(m, np.nan),
        ("",) * m,
        ("",) * m,
    )
    return replace(made, **changes)


SIGMA = 0.05  # [mm]
SPREAD = [[0.1, 0.1], [0.9, 0.15], [0.5, 0.9], [0.5, 0.1], [0.5, 0.9], [0.5, 0.5]]  # front: u up, v along x


def hidden(found, rng):
    """base_T_workpiece of a box that stands anyhow, but within reach."""
    T = np.eye(4)
    T[:3, :3] = rotation(*rng.uniform(-0.3, 0.3, 3))
    T[:3, 3] = np.array([200, 150, 100]) + rng.uniform(-60, 60, 3) - T[:3, :3] @ [200, 150, 75]
    return inverse(transform(found.theta[:6])) @ T


def touched(found, box, T, face, fraction, rng, theta=None, proud=None):
    """What robots measure on workpieces; T and theta one a touch, or one for all."""
    count = len(face)
    T = np.broadcast_to(T, (count, 4, 4))
    theta = np.broadcast_to(found.theta if theta is None else theta, (count, len(found.theta)))
    point = np.stack([box.by_name[f].point(np.array(s), np.array(t)) for f, (s, t) in zip(face, fraction, strict=True)])
    q = postures(found, box, T, face, point, rng)
    return latched(found, box, T, face, q, theta, rng, SIGMA, proud)
