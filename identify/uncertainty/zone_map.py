"""The tip error to expect over the weld zone, from the covariance of a calibration."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.ik import reach
from identify.model.io.calibration_file import Calibration

GRID = (14, 11, 3)
STARTS = 4  # of the inverse kinematics at each point, on other branches
MORE = 120  # starts at points that none of these reached: near the posture of the nearest point, else anywhere
AROUND = 0.1  # of the joint ranges, that a start is off the posture of the nearest point


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
    best, posture = np.full(len(point), np.nan), np.full((len(point), len(robot.joints)), np.nan)
    for k in range(STARTS + MORE):
        todo = np.arange(len(point)) if k < STARTS else np.flatnonzero(np.isnan(best))
        if not len(todo):
            break
        start = rng.uniform(robot.lower, robot.upper, (len(todo), len(robot.joints)))
        if k < STARTS:
            start = start / 2
        elif k % 2 and not np.isnan(best).all():
            start = _nearest(point[todo], point, posture)
            start += AROUND * (robot.upper - robot.lower) * rng.standard_normal(start.shape)
        solution = reach(c.cell.kinematics, c.theta, point[todo], down[todo], start, free_roll=True)
        good, q = todo[solution.reached()], solution.q[solution.reached()]
        best[good] = np.fmin(best[good], np.sqrt(np.trace(c.tip_covariance(q), axis1=1, axis2=2)))
        posture[good] = q
    return ZoneMap(axes[0], axes[1], axes[2], best.reshape(GRID))


def _nearest(
    point: Float[np.ndarray, "some 3"], points: Float[np.ndarray, "all 3"], posture: Float[np.ndarray, "all joints"]
) -> Float[np.ndarray, "some joints"]:
    """The posture at the nearest of the points that are reached."""
    reached = np.flatnonzero(~np.isnan(posture).any(axis=1))
    away = np.linalg.norm(point[:, None] - points[reached], axis=2)
    return posture[reached[away.argmin(axis=1)]]
