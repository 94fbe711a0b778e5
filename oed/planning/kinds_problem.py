"""Measurements of several kinds that can be made, what each would tell, and designs over all of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.calibration_file import Calibration
from identify.model.measurement import MEASUREMENTS, Measurements, rows, spacing_rows
from identify.model.touch import Plan
from identify.model.zone import zone_poses
from identify.uncertainty.coordinates import of_all_unknowns, of_identifiable
from identify.uncertainty.information import Information, prior_information
from identify.uncertainty.named_unknowns import named
from identify.uncertainty.posterior import posterior
from identify.uncertainty.promise import Promise, TipErrors, promise
from oed.candidates.edge_margins import SIGMAS
from oed.candidates.kinds import measurements, planned_cell
from oed.criteria.criteria import criterion_named
from oed.design.budget import BudgetDesign, budget_design
from oed.planning.candidate_set import CandidateSet, around, plan_of
from probe.motion.clearance import Clearance
from probe.motion.edges import Edges, like
from probe.motion.edges import astray as blocked_ends
from probe.motion.roadmap import Roadmap, home, lifts
from probe.motion.tour import Order

COUNT = 2000  # candidates of each kind; a third of it of those with three rows, a sixth with six
NAMED = 3  # unknowns that explain a limit
MANY = 1e8  # times that all candidates are measured, for what no number of them shows


@dataclass(frozen=True, eq=False)
class Offer:
    """Candidates of one kind: what they would tell, and where the robot stands for them."""

    kind: str
    minutes: float  # that one takes
    rows: Float[np.ndarray, "rows unknowns"]  # whitened
    owner: Int[np.ndarray, " rows"]  # candidate of each row
    postures: Plan  # of all candidates
    table: Measurements | None  # None for touches
    touches: CandidateSet | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.postures)

    def of(self, index: Int[np.ndarray, " some"]) -> Float[np.ndarray, "rows unknowns"]:
        """The rows of some candidates."""
        return self.rows[np.isin(self.owner, index)]


@dataclass(frozen=True, eq=False)
class Limit:
    """What any number of the candidates leaves."""

    rms_mm: float
    """RMS tip error in the zone."""
    names: tuple[str, ...]
    """Unknowns that have most of the direction from which most of it comes."""


@dataclass(frozen=True, eq=False)
class KindsProblem:
    """Candidates of several kinds, and what is known before them."""

    prior: Information
    clearance: Clearance
    offers: tuple[Offer, ...]
    notes: tuple[str, ...] = ()

    @property
    def cell(self) -> Cell:
        """The cell in which is measured."""
        return self.prior.unknowns.cell

    @cached_property
    def tip(self) -> Float[np.ndarray, "poses 3 unknowns"]:
        """Rows of the tip at the poses of the zone [mm]."""
        return self.prior.unknowns.tip_rows(zone_poses(self.cell, self.prior.theta), self.prior.theta)

    @cached_property
    def rows(self) -> Float[np.ndarray, "rows unknowns"]:
        """Rows of the candidates of all kinds, one kind after the other."""
        return np.concatenate([offer.rows for offer in self.offers])

    def only(self, kind: str) -> "KindsProblem":
        """The same with the candidates of one kind."""
        return replace(self, offers=tuple(offer for offer in self.offers if offer.kind == kind))

    def design(
        self,
        budget: float,
        criterion: str = "V",
        rng: np.random.Generator | None = None,
        allowed: Sequence[Bool[np.ndarray, " candidates"]] | None = None,
        excursions: int | None = None,
    ) -> tuple[BudgetDesign, list[Int[np.ndarray, " some"]]]:
        """The best measurements for a budget of minutes among those allowed, and the candidates chosen of each kind."""
        allowed = [np.ones(len(offer), dtype=bool) for offer in self.offers] if allowed is None else allowed
        measure = criterion_named(criterion)
        coordinates = of_all_unknowns(self.prior, self.rows) if measure.needs_zone else of_identifiable(self.prior)
        parts = [offer.of(np.flatnonzero(some)) for offer, some in zip(self.offers, allowed, strict=True)]
        owners = [o.owner[some[o.owner]] for o, some in zip(self.offers, allowed, strict=True)]
        counted = np.concatenate([[f"{k} {i}" for i in owner] for k, owner in enumerate(owners)])
        owner = np.cumsum(np.concatenate([[True], counted[1:] != counted[:-1]])) - 1
        cost = np.concatenate([np.full(some.sum(), o.minutes) for o, some in zip(self.offers, allowed, strict=True)])
        further = {} if excursions is None else {"excursions": excursions}
        try:
            design = budget_design(
                np.concatenate(parts) @ coordinates.basis,
                owner,
                cost,
                budget,
                measure,
                rng=rng,
                prior=coordinates.precision,
                zone=coordinates.of_tip(self.tip) if measure.needs_zone else None,
                **further,
            )
        except ValueError as error:
            raise InputError(f"no plan for {budget:g} minutes: {error}") from None
        ends = np.cumsum([0, *(int(some.sum()) for some in allowed)])
        members = [
            np.flatnonzero(some)[design.members[(design.members >= a) & (design.members < b)] - a]
            for some, a, b in zip(allowed, ends[:-1], ends[1:], strict=True)
        ]
        return design, members

    def promised(self, members: Sequence[Int[np.ndarray, " some"]], times: float = 1.0) -> Promise:
        """The promise after the chosen candidates of each kind, made `times` times; touches miss as they do."""
        further = [o.of(index) for o, index in zip(self.offers, members, strict=True) if o.touches is None]
        rows = np.sqrt(times) * np.concatenate([np.zeros((0, len(self.prior.R))), *further])
        for offer, index in zip(self.offers, members, strict=True):
            if offer.touches is not None and len(index):
                return offer.touches.promise(offer.touches.candidates.take(index), times, further=rows)
        return promise(TipErrors(self.prior.updated(rows).root(self.tip)))

    def limit(self) -> Limit:
        """The error in the zone that is left however often all candidates are measured, and whence it comes."""
        posterior = self.prior.updated(np.sqrt(MANY) * self.rows)
        tip = posterior.root(self.tip)
        _, s, Vt = np.linalg.svd(tip.reshape(-1, tip.shape[-1]), full_matrices=False)
        direction = np.abs(posterior.root(np.eye(len(posterior.R))) @ Vt[0])
        most = np.argsort(-direction)[:NAMED]
        names = tuple(self.prior.unknowns.names[i] for i in most if direction[i] > 0.3 * direction.max())
        return Limit(float(np.sqrt((s**2).sum() / len(self.tip))), names)

    def visit(
        self, offer: Offer, index: Int[np.ndarray, " some"], rng: np.random.Generator
    ) -> tuple[Order, Bool[np.ndarray, "some some"]]:
        """A short order of some candidates of a kind along clear ways, and which have ways to each other."""
        if len(index) == 0:
            return Order(index, np.empty((0, 0, offer.postures.q.shape[1])), 0.0, ()), np.ones((0, 0), dtype=bool)
        if offer.touches is not None:
            return offer.touches.visit(offer.touches.candidates.take(index), rng)
        plan = offer.postures.take(index)
        above = lifts(self._edges, plan.q, plan.normal)
        return Roadmap(self._edges, above[~np.isnan(above).any(axis=1)], home(self.clearance)).order(plan, rng)

    @cached_property
    def _edges(self) -> Edges:
        spread = np.linalg.norm(self.prior.root(self.tip), axis=2).max(axis=1)
        return Edges(self.clearance, keep=SIGMAS * float(np.median(spread)))

    def astray(
        self, offer: Offer, index: Int[np.ndarray, " some"], order: Order, clear: Bool[np.ndarray, "some some"]
    ) -> Bool[np.ndarray, " candidates"]:
        """Candidates like those at the ends of blocked ways."""
        if not order.blocked:
            return np.zeros(len(offer), dtype=bool)
        bad = blocked_ends(clear, np.array([order.index[[i, i + 1]] for i in order.blocked]))
        at, good = offer.postures.approach, np.setdiff1d(np.arange(len(index)), bad)
        return like(self.cell, at, at[index[bad]], at[index[good]])


def kinds_problem(
    cell: Cell, kinds: Sequence[str], rng: np.random.Generator, *, after: Calibration | None = None, count: int = COUNT
) -> "KindsProblem":
    """The candidates of some kinds, and what is known before them; raises InputError where a kind has none."""
    cell, notes = planned_cell(cell)
    for name, pose in (("base", cell.base), ("tool", cell.tool)):
        if pose is None:
            raise InputError(f"{name}: fit leaves open where the {name} stands; write its pose to plan measurements")
    prior = prior_information(cell) if after is None else posterior(after, cell)
    prior = _with_points(prior)
    clearance = Clearance(prior.unknowns.cell, prior.theta)
    offers = tuple(
        _touches(prior, rng, count) if kind == "touch" else _others(prior, kind, clearance, rng, count)
        for kind in dict.fromkeys(kinds)
    )
    return KindsProblem(prior, clearance, offers, notes + tuple(note for offer in offers for note in offer.notes))


def _with_points(prior: Information) -> Information:
    """What is known with the further frames and points of the cell, and the spacings between points."""
    cell, count = prior.unknowns.cell, len(prior.R)
    unknowns = replace(prior.unknowns, named=tuple(named(cell)))
    R = np.diag(np.sqrt(unknowns.precision))
    R[:count, :count] = prior.R
    whole = Information(unknowns, prior.theta, R)
    if not cell.spacings:
        return whole
    pairs = [(s.start, s.end, s.distance, s.sigma) for s in cell.spacings]
    return whole.updated(unknowns.rows(spacing_rows(pairs, cell.places, len(cell.robot.joints)), prior.theta))


def _touches(prior: Information, rng: np.random.Generator, count: int) -> Offer:
    cell, touches = prior.unknowns.cell, around(prior, rng, count)
    plan = plan_of(touches.candidates)
    return Offer("touch", cell.device("touch").minutes, touches.rows, np.arange(len(plan)), plan, None, touches)


def _others(prior: Information, kind: str, clearance: Clearance, rng: np.random.Generator, count: int) -> Offer:
    cell, theta = prior.unknowns.cell, prior.theta
    table, notes = measurements(
        cell, kind, rng, max(count // MEASUREMENTS[kind].equations, 1), theta=theta, clearance=clearance
    )
    lines = rows(cell.wire, [table], cell.robot, cell.places)
    tip, R = cell.kinematics.tip(table.q, theta)
    plan = Plan(table.ids, ("",) * len(table), tip, -R[:, :, 2], table.q, table.q)
    return Offer(
        kind, cell.device(kind).minutes, prior.unknowns.rows(lines, theta), lines.owner, plan, table, None, notes
    )
