"""Touches chosen to notice change: a dozen that tell slips, knocks and shifts apart."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.calibration_file import Calibration
from identify.model.touch import Plan
from identify.uncertainty.information import Knowledge, knowledge_after, touch_sigma
from oed.design.matrix import sensitivities
from oed.planning.candidate_set import Offer, offer, plan_of
from oed.planning.workpiece import chosen
from probe.motion.roadmap import with_via
from probe.motion.tour import Order

USUAL = 12
COUNT = 6000  # touches on offer


def plan_check(
    cell: Cell,
    calibration: Calibration,
    sizes: Mapping[str, float],
    n: int = USUAL,
    rng: np.random.Generator | None = None,
    *,
    count: int = COUNT,
) -> tuple[Plan, Order]:
    """Choose touches that tell the most about changes since a calibration, and their order.

    `sizes` names the parameters that change and says how far is usual [mm] or [rad]: the touches tell them apart best,
    by log det, and stay so far off edges and obstacles that such changes do no harm. Raises InputError where so many
    touches are not to be had.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    offered = offer(cell, rng, after=_loosened(calibration, sizes), count=count)
    if not 1 <= n <= len(offered.found):
        raise InputError(f"{n} touches are asked for, and {len(offered.found)} were found that can be made")
    before = knowledge_after(offered.known.cell, calibration)
    telling = _Telling(_changes(before, sizes), offered.found, before, lifting=offered.lifting)
    touches, order = chosen(telling, n, "D", rng)
    return with_via(plan_of(touches), order.via), order


def _loosened(calibration: Calibration, sizes: Mapping[str, float]) -> Calibration:
    """What is known of a robot that may have changed since it was identified."""
    names = [name for name in calibration.cell.robot.parameters if name in sizes or name in calibration.estimated]
    covariance = np.diag([sizes.get(name, 0.0) ** 2 for name in names])
    known = [names.index(name) for name in calibration.estimated]
    covariance[np.ix_(known, known)] += calibration.covariance
    return replace(calibration, estimated=tuple(names), covariance=covariance)


@dataclass(frozen=True, eq=False)
class _Telling(Offer):
    """Touches on offer, which a calibration foretells only as well as it knows the robot."""

    before: Knowledge

    @cached_property
    def sigma(self) -> Float[np.ndarray, " touches"]:
        """Standard deviation [mm] of every touch from where the calibration foretells it, if nothing has changed."""
        own = touch_sigma(self.before.cell, self.found.names())
        rows = self.before.rows(self.found.q, self.found.normal, own)
        return own * np.sqrt(1 + sensitivities(rows, self.before.spread))


def _changes(known: Knowledge, sizes: Mapping[str, float]) -> Knowledge:
    """Changes as what is not known, each as large as is usual."""
    names = tuple(name for name in known.cell.robot.parameters if name in sizes)
    scale = known.cell.scale[[known.cell.robot.parameters.index(name) for name in names]]
    spread = np.diag((np.array([sizes[name] for name in names]) / scale) ** 2)
    return replace(known, names=names, precision=np.linalg.inv(spread), spread=spread)
