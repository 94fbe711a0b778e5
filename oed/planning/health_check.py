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
from identify.uncertainty.coordinates import Coordinates
from identify.uncertainty.information import Information
from identify.uncertainty.posterior import posterior
from oed.planning.candidate_set import CandidateSet, around, plan_of
from oed.planning.workpiece import best_in_order
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
    before = posterior(calibration, cell)
    candidate_set = around(_changed(before, sizes), rng, count)
    if not 1 <= n <= len(candidate_set.candidates):
        raise InputError(f"{n} touches are asked for, and {len(candidate_set.candidates)} were found that can be made")
    touches, order = best_in_order(_Changes(candidate_set.prior, candidate_set.candidates, before, sizes), n, "D", rng)
    return with_via(plan_of(touches), order.via), order


def _changed(before: Information, sizes: Mapping[str, float]) -> Information:
    """What is known of a robot that may have changed since it was identified."""
    names = before.unknowns.cell.robot.parameters
    some = [i for i, name in enumerate(names) if name in sizes or i in before.unknowns.parameters]
    C = np.diag([sizes.get(names[i], 0.0) ** 2 for i in some])
    parameters = [some.index(i) for i in before.unknowns.parameters]
    C[np.ix_(parameters, parameters)] += before.covariance()[: len(parameters), : len(parameters)]
    unknowns = replace(before.unknowns, parameters=np.array(some))
    return Information.of_covariance(unknowns, before.theta, [names[i] for i in some], C)


@dataclass(frozen=True, eq=False)
class _Changes(CandidateSet):
    """Candidates as they show changes of usual `sizes`, which a calibration foretells as well as it knows the robot."""

    before: Information
    sizes: Mapping[str, float]

    @cached_property
    def rows(self) -> Float[np.ndarray, "touches unknowns"]:
        """Rows in units of how exactly the calibration foretells each touch, if nothing has changed."""
        rows = self.before.unknowns.rows(self.candidates.rows(self.cell), self.theta)
        return super().rows / np.sqrt(1 + self.before.variance(rows))[:, None]

    @cached_property
    def identifiable(self) -> Coordinates:
        """The changes, each in units of its size."""
        unknowns, names = self.prior.unknowns, tuple(self.sizes)
        index = unknowns.index(names)
        basis = np.zeros((len(unknowns), len(names)))
        basis[index, range(len(names))] = np.array([self.sizes[name] for name in names]) / unknowns.scale[index]
        return Coordinates(self.prior, basis, np.eye(len(names)), names)
