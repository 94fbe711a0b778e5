"""An arm of boxes before a jig of boxes, and their distances by least squares."""

from dataclasses import replace

import numpy as np

from identify.model.cell import Zone

BASE = np.array([200.0, 702.0, 212.0, -np.pi / 2, 0.0, 0.0])
TOOL = np.array([0.0, 0.0, 300.0, 0.0, np.radians(-18), 0.0])
ZONE = Zone(np.array([[0.0, 400.0], [0.0, 300.0], [0.0, 250.0]]), np.radians(60))


def bare(cell, nearer=350.0):
    """Without the torch, whose capsules have tests of their own, and nearer to the jig [mm]."""
    return replace(cell, tool=np.zeros(6), base=cell.base - [0, nearer, nearer / 2, 0, 0, 0])
