"""Real measurements of an ABB IRB 120 by a laser tracker, as positions and as single coordinates."""

import numpy as np

from identify.model.touch import HIT, Positions, Touches

SIGMA = 0.1  # [mm], repeatability of the robot by its data sheet, rounded up


def positions(measured, which, joints="q"):
    ids = tuple(str(i) for i in which)
    return Positions(ids, measured[joints][which], measured["point"][which], np.full(len(which), SIGMA))


def single_coordinates(measured, which):
    """One coordinate a pose, x, y, z in turn, as a touch on a plane would give it."""
    m, blank = len(which), ("",) * len(which)
    normal = np.eye(3)[np.arange(m) % 3]
    offset = (normal * measured["point"][which]).sum(axis=1)
    ids = tuple(str(i) for i in which)
    return Touches(
        ids,
        blank,
        measured["q"][which],
        normal,
        offset,
        np.full(m, SIGMA),
        (HIT,) * m,
        np.full(m, np.nan),
        blank,
        blank,
    )
