"""Frames of links by elementary motions, and points sampled along capsules: another way to see clearances."""

import numpy as np
from oracle import motions


def frames(cell, q):
    """Frames of all links in the jig frame, one elementary motion after another."""
    T, out = np.eye(4), []
    for i, motion in enumerate(motions(cell.robot, q, cell.theta)):
        T = T @ motion.matrix
        if i >= 6 and (i - 6) % 5 == 0 and len(out) <= len(cell.robot.joints):
            out.append(T)
    return out


def balls(cell, capsules, q, n=200):
    """Points along capsules in the jig frame, and the capsules' radii."""
    links = frames(cell, q)
    share = np.linspace(0, 1, n)[:, None]
    local = [np.array(c.start) + share * (np.array(c.end) - np.array(c.start)) for c in capsules]
    return [p @ links[c.link][:3, :3].T + links[c.link][:3, 3] for p, c in zip(local, capsules, strict=True)]
