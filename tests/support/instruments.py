"""What exact instruments read, by kinematics written independently."""

import numpy as np
from oracle import forward

from identify.model.cell import Wire
from identify.model.frames import euler
from identify.model.measurement import rows
from identify.model.touch import HIT, Contacts, Distances, Poses, Positions, Touches

ANCHOR = np.array([150.0, 90.0, -40.0])


def measured(kind, cell, q):
    """What an exact instrument reads of each kind, by kinematics written independently."""
    frames = np.stack([forward(cell.robot, row, cell.theta) for row in q])
    tip, m = frames[:, :3, 3], len(q)
    ids, sigma, blank = tuple(map(str, range(m))), np.full(m, 0.1), ("",) * m
    if kind == "touch":
        normal = np.eye(3)[np.arange(m) % 3]
        offset = (normal * tip).sum(axis=1)
        return Touches(ids, blank, q, normal, offset, sigma, (HIT,) * m, np.full(m, np.nan), blank, blank)
    if kind == "position":
        return Positions(ids, q, tip, sigma)
    if kind == "pose":
        return Poses(ids, q, tip, euler(frames[:, :3, :3]), sigma, sigma / 100)
    if kind == "distance":
        return Distances(ids, q, ("pin",) * m, np.linalg.norm(tip - ANCHOR, axis=1), sigma)
    return None


def equations(kind, cell, q):
    point = Wire(0.0, "point")
    if kind == "contact":  # each pose in a socket of its own
        tip = np.stack([forward(cell.robot, row, cell.theta)[:3, 3] for row in q])
        names = tuple(f"hole{i}" for i in range(len(q)))
        table = Contacts(tuple(map(str, range(len(q)))), q, names, np.full(len(q), 0.1))
        return rows(point, [table], places=dict(zip(names, tip, strict=True)))
    return rows(point, [measured(kind, cell, q)], places={"pin": ANCHOR})
