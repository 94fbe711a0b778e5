"""Fit a poorer model to an identified one: the parameters that a format can carry, and nothing else."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from identify.model.frames import transform
from identify.model.io.calibration_file import Calibration

POSES = 300  # at which formats and poorer models are compared
DRAWS = 20_000
LEVERS = ((0.0, 0.0, 0.0), (100.0, 0.0, 0.0), (0.0, 100.0, 0.0))  # [mm] from the tip: its orientation counts too
ROUNDS = 20
ENOUGH = 1e-7  # of the scale of a parameter
STEP = 1e-6  # of the scale of a parameter, for differences
WEAK = 1e-6  # singular values below this part of the largest are not moved along: nearly parallel axes stay put


Levers = Sequence[tuple[float, float, float]]


def fitted(
    calibration: Calibration,
    free: Sequence[str],
    start: Float[np.ndarray, " parameters"],
    q: Float[np.ndarray, "poses joints"] | None = None,
    levers: Levers = LEVERS,
) -> Float[np.ndarray, " parameters"]:
    """Parameters whose tips come nearest to the identified ones, only the free ones moved from a start.

    Compared are points at `levers` from the tip, at poses `q`; those of `sample` if not given.
    """
    names = calibration.cell.robot.parameters
    index = [names.index(name) for name in free]
    q, scale = sample(calibration) if q is None else q, calibration.cell.scale[index]
    targets, theta = _points(calibration, q, calibration.theta[None], levers), start.copy()
    for _ in range(ROUNDS):
        steps = np.zeros((2 * len(index) + 1, len(theta)))
        steps[np.arange(len(index)), index] = STEP * scale
        steps[len(index) + np.arange(len(index)), index] = -STEP * scale
        tips = _points(calibration, q, theta + steps, levers)
        J = (tips[: len(index)] - tips[len(index) : -1]).T / (2 * STEP)
        move = np.linalg.lstsq(J, (targets - tips[-1:])[0], rcond=WEAK)[0]
        theta[index] += move * scale
        if np.abs(move).max() < ENOUGH:
            break
    return theta


def geometric(calibration: Calibration) -> Calibration:
    """The robot without joint errors whose tips come nearest to the identified one; itself where it has none."""
    robot = calibration.cell.robot
    if not robot.errors:
        return calibration
    beyond = {name for name, _, _ in robot.error_parameters}
    start = calibration.theta.copy()
    start[[name in beyond for name in robot.parameters]] = 0.0
    theta = fitted(calibration, [name for name in robot.parameters if name not in beyond], start)
    geometric = np.array([name not in beyond for name in robot.parameters])
    free = np.array([name not in beyond for name in calibration.estimated])
    bare = robot.with_errors(())
    return replace(
        calibration,
        cell=replace(
            calibration.cell,
            robot=bare,
            fixed=calibration.cell.fixed - beyond,
            bounds={k: v for k, v in calibration.cell.bounds.items() if k not in beyond},
        ),
        theta=theta[geometric],
        start=calibration.start[geometric],
        estimated=tuple(name for name in calibration.estimated if name not in beyond),
        covariance=calibration.covariance[np.ix_(free, free)],
        combinations={k: v for k, v in calibration.combinations.items() if k not in beyond},
    )


def independent(calibration: Calibration, names: Sequence[str]) -> list[str]:
    """The parameters, in an order of preference, that those before them do not already carry."""
    robot, theta = calibration.cell.robot, calibration.theta
    index = [robot.parameters.index(name) for name in names]
    scale = calibration.cell.scale[index]
    steps = np.zeros((len(index) + 1, len(theta)))
    steps[np.arange(len(index)), index] = STEP * scale
    tips = _points(calibration, sample(calibration), theta + steps)
    basis, some = np.empty((tips.shape[1], 0)), list[str]()
    for name, column in zip(names, (tips[:-1] - tips[-1:]) / STEP, strict=True):
        rest = column - basis @ (basis.T @ column)
        if np.linalg.norm(rest) > 1e-4 * np.linalg.norm(column):
            basis, some = np.column_stack([basis, rest / np.linalg.norm(rest)]), [*some, name]
    return some


def _points(
    calibration: Calibration,
    q: Float[np.ndarray, "poses joints"],
    thetas: Float[np.ndarray, "models parameters"],
    levers: Levers = LEVERS,
) -> Float[np.ndarray, "models points"]:
    """The tip and points beside it, of several models at all poses, one row a model."""
    tip = calibration.cell.kinematics.tip
    p, R = tip(np.tile(q, (len(thetas), 1)), np.repeat(thetas, len(q), axis=0))
    points = [p + R @ np.array(lever) for lever in levers]
    return np.stack(points, axis=1).reshape(len(thetas), -1)


def folded(calibration: Calibration, theta: Float[np.ndarray, " parameters"]) -> tuple[np.ndarray, np.ndarray]:
    """jig_T_first and last_T_tip: base and tool, with what stands before the first joint and behind the last link."""
    robot = calibration.cell.robot
    return transform(theta[:6]) @ robot.base_T_first, robot.last_T_flange @ transform(theta[-6:])


def sample(calibration: Calibration) -> Float[np.ndarray, "poses joints"]:
    """Joint values within the limits, the same ones each time; those with the tip in the zone where enough are."""
    cell = calibration.cell
    q = np.random.default_rng(0).uniform(cell.robot.lower, cell.robot.upper, (DRAWS, len(cell.robot.joints)))
    if cell.zone is not None:
        tip = cell.kinematics.tip(q, calibration.theta)[0]
        inside = ((tip > cell.zone.box[:, 0]) & (tip < cell.zone.box[:, 1])).all(axis=1)
        q = q[inside] if inside.sum() >= POSES // 3 else q
    return q[:POSES]
