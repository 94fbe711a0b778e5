"""Every robot of the library before a jig that it can touch."""

from dataclasses import replace
from functools import cache

import numpy as np

from identify.model.cell import DEG, Cell
from identify.model.io.description import library, read_cell, read_jig, read_robot

PLACES = {  # base x, y, z, rz, and tool x, z, ry
    "arc-welder": ((340, 740, 350, -90), (0, 410, -18)),
    "irb120": ((200, -400, 0, 90), (0, 250, -30)),
    "puma560": ((200, 700, 400, -90), (0, 410, -18)),
    "arm7": ((200, 750, 0, -90), (0, 250, -30)),
    "scara": ((200, -300, 0, 90), (60, 100, -45)),
}


@cache
def cell_of(robot: str, jig: str = "step-block") -> Cell:
    """A robot before a jig, otherwise as the cell of the paper; one object each, so that its functions compile once."""
    (x, y, z, rz), (tx, tz, ry) = PLACES[robot]
    return replace(
        read_cell(library("cells")["arc-welder"]),
        robot=read_robot(library("robots")[robot]),
        jig=read_jig(library("jigs")[jig]),
        base=np.array([x, y, z, rz * DEG, 0, 0]),
        tool=np.array([tx, 0, tz, 0, ry * DEG, 0]),
    )
