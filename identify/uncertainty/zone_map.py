"""The tip error to expect over the weld zone, from the covariance of a calibration."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.ik import reach
from identify.model.io.calibration_file import Calibration

GRID = (14, 11, 3)
STARTS = 4  # of the inverse kinematics at each point, on other branches


@dataclass(frozen=True, eq=False)
class ZoneMap:
    """Expected tip errors at points of a grid, torch straight down."""

    x: Float[np.ndarray, " x"]  # [mm]
    y: Float[np.ndarray, " y"]
    z: Float[np.ndarray, " z"]
    error: Float[np.ndarray, "x y z"]  # [mm], RMS; NaN out of reach


def zone_map(c: Calibration) -> ZoneMap | None:
    """The map of the cell's zone, lowest error of the branches found; None where the cell has no zone."""
    if c.cell.zone is None:
        return None
    axes = [np.linspace(lo, hi, n) for (lo, hi), n in zip(c.cell.zone.box, GRID, strict=True)]
    point = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    down = np.tile(np.diag([1.0, -1.0, -1.0]), (len(point), 1, 1))
    robot, rng = c.cell.robot, np.random.default_rng(0)
    best = np.full(len(point), np.nan)
    for _ in range(STARTS):
        start = rng.uniform(robot.lower, robot.upper, (len(point), len(robot.joints))) / 2
        reached = reach(c.cell.kinematics, c.theta, point, down, start, free_roll=True)
        variance = np.trace(c.tip_covariance(reached.q), axis1=1, axis2=2)
        best = np.fmin(best, np.where(reached.reached(), np.sqrt(variance), np.nan))
    return ZoneMap(axes[0], axes[1], axes[2], best.reshape(GRID))
