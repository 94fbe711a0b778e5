"""What has changed since earlier calibrations of the same robot: parameters, and the tip all over the zone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError
from identify.model.io.calibration_file import Calibration, Errors, summarize
from identify.model.zone import zone_poses
from identify.report.page import table
from identify.uncertainty.promise import INTERVAL

LISTED = 12  # parameters, those first that changed most


@dataclass(frozen=True, eq=False)
class Change:
    """From one earlier calibration to the present one."""

    name: str  # of the earlier file
    parameters: Float[np.ndarray, " parameters"]  # present minus earlier [mm, rad]
    sigma: Float[np.ndarray, " parameters"]  # of that [mm, rad]; 0 where a calibration did not estimate the parameter
    tip: Errors | None  # distances between the tips of both over the zone; None where there is no zone


def changes(c: Calibration, earlier: Sequence[tuple[str, Calibration]]) -> list[Change]:
    """Changes since earlier calibrations, by the names of their files.

    Raises InputError if an earlier calibration is of a robot with other parameters.
    """
    q = zone_poses(c.cell, c.theta) if c.cell.zone is not None else None
    return [_change(c, name, before, q) for name, before in earlier]


def _change(c: Calibration, name: str, before: Calibration, q: Float[np.ndarray, "poses joints"] | None) -> Change:
    names = c.cell.robot.parameters
    theta, sigma = np.zeros(len(names)), np.zeros(len(names))
    place = {n: i for i, n in enumerate(before.cell.robot.parameters)}
    missing = [n for n in names if n not in place and not _beyond(c, n)]
    if missing or before.cell.robot.name != c.cell.robot.name:
        raise InputError(
            f"{name} is a calibration of robot '{before.cell.robot.name}', not of '{c.cell.robot.name}' with the same "
            "joints; give --since earlier calibrations of the same robot"
        )
    shared = [i for i, n in enumerate(names) if n in place]
    old = [place[names[i]] for i in shared]
    theta[shared] = c.theta[shared] - before.theta[old]
    both = (c.sigma[shared] > 0) & (before.sigma[old] > 0)
    sigma[shared] = np.where(both, np.hypot(c.sigma[shared], before.sigma[old]), 0.0)
    tip = None
    if q is not None:
        apart = c.cell.kinematics.tip(q, c.theta)[0] - before.cell.kinematics.tip(q, before.theta)[0]
        tip = summarize(np.linalg.norm(apart, axis=1))
    return Change(name, theta, sigma, tip)


def _beyond(c: Calibration, name: str) -> bool:
    """Whether a parameter belongs to an error model, which an earlier calibration need not have had."""
    return name in {parameter for parameter, _, _ in c.cell.robot.error_parameters}


def history(c: Calibration, earlier: Sequence[tuple[str, Calibration]]) -> str:
    """Two tables: the tip over the zone since each earlier calibration, and the parameters that changed most."""
    if not earlier:
        return ""
    comparisons = changes(c, earlier)
    tips = [
        [change.name, *(f"{v:.3f}" for v in (change.tip.mean_mm, change.tip.p95_mm, change.tip.max_mm))]
        for change in comparisons
        if change.tip is not None
    ]
    unit, robot = c.cell.robot.parameter_unit(), c.cell.robot
    size = np.max([np.abs(x.parameters) / np.where(x.sigma > 0, x.sigma, np.inf) for x in comparisons], axis=0)
    first = [i for i in np.argsort(-size, kind="stable")[:LISTED] if size[i] > 0]
    rows = [
        [f"{robot.parameters[i]} [{robot.units[i]}]", *(_drift(x, i, unit[i], robot.decimals[i]) for x in comparisons)]
        for i in first
    ]
    head = "<h2>Since earlier calibrations</h2>"
    over = table(["tip change over the zone since", "mean, mm", "95 %, mm", "max, mm"], tips) if tips else ""
    note = '<p class="soft">Parameters that changed most, with 95 % intervals; * beyond them.</p>'
    return head + over + note + table(["parameter", *(f"since {x.name}" for x in comparisons)], rows)


def _drift(change: Change, i: int, unit: float, digits: int) -> str:
    """The change of one parameter in file units, with its interval, and a star where it is sure."""
    if change.sigma[i] == 0:
        return "not estimated by both"
    star = " *" if abs(change.parameters[i]) > INTERVAL * change.sigma[i] else ""
    return f"{change.parameters[i] / unit:+.{digits}f} +- {INTERVAL * change.sigma[i] / unit:.{digits}f}{star}"
