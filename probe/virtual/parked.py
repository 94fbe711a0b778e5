"""Where a virtual robot stands before anybody has moved it."""

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.ik import reach

ABOVE = 150.0  # [mm] over the highest face of the jig
STARTS = 64


def parked(cell: Cell) -> Float[np.ndarray, " joints"]:
    """Jogged above the jig, the torch straight down, as an operator leaves a robot; zeros where it cannot reach there.

    Of all postures the one nearest to the middle of the joint limits.
    """
    robot = cell.robot
    zeros = np.clip(np.zeros(len(robot.joints)), robot.lower, robot.upper)
    if cell.jig is None:
        return zeros
    corners = np.concatenate([[f.origin, f.origin + f.u, f.origin + f.v, f.origin + f.u + f.v] for f in cell.jig.faces])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    over = np.array([*(lower + upper)[:2] / 2, upper[2] + ABOVE])
    start = np.random.default_rng(3).uniform(robot.lower, robot.upper, (STARTS, len(robot.joints)))
    down = np.tile(np.diag([1.0, -1.0, -1.0]), (STARTS, 1, 1))
    found = reach(cell.kinematics, cell.theta, np.tile(over, (STARTS, 1)), down, start, free_roll=True)
    if not found.reached().any():
        return zeros
    q = found.q[found.reached()]
    middle, half = (robot.upper + robot.lower) / 2, (robot.upper - robot.lower) / 2
    return np.asarray(q[np.argmin((((q - middle) / half) ** 2).sum(axis=1))])
