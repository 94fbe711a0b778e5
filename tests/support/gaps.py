"""How far the wire is from the boxes of a jig."""

import numpy as np


def gap(cell, q, length=0.0):
    """Distance of the tip, or of some length of wire from it on [mm], from the nearest box of the jig [mm]."""
    tip, R = cell.kinematics.tip(q, cell.theta)
    p = tip[:, None] - np.linspace(0, length, 41)[:, None] * R[:, None, :, 2]
    boxes = [(np.array(b.lower), np.array(b.upper)) for b in cell.jig.boxes]
    away = [np.linalg.norm(np.maximum(np.maximum(lo - p, p - hi), 0), axis=2) for lo, hi in boxes]
    return np.min(away, axis=(0, 2))
