"""What a plan is chosen from: all touches that can be made, what each would tell, and the zone where it counts."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.io.calibration_file import Calibration
from identify.model.touch import Plan
from identify.model.zone import zone_poses
from identify.uncertainty.coordinates import Coordinates, of_all_unknowns, of_identifiable
from identify.uncertainty.information import Information, prior_information
from identify.uncertainty.posterior import posterior
from identify.uncertainty.promise import Promise, TipErrors, promise
from oed.candidates.candidates import COUNT, STRUCTURED, Candidates, candidates
from oed.candidates.feasibility import Feasibility
from oed.criteria.criteria import criterion_named
from oed.criteria.criterion import Criterion
from oed.planning.searches import Searches, searches
from probe.motion.edges import ROBOTS, Edges
from probe.motion.roadmap import Roadmap, home, lifts
from probe.motion.room import SIGMAS
from probe.motion.tour import Order

RISK = 0.05  # share of the robots drawn from what is known whose arms may hit something in a touch
MOST = 0.5  # share of the touches in which the arm of a robot may hit something: such a robot cannot stand there
REMEMBERED = 3  # sets of touches whose searches are kept: a plan, and those that its curve compares it with
# what sets of other candidates share
SHARED = (
    "zone",
    "tip",
    "_tip",
    "all_unknowns",
    "identifiable",
    "feasibility",
    "edges",
    "_lifts",
    "_home",
)  # by sets alike


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """Touches that can be made, and what is known before them."""

    prior: Information
    candidates: Candidates
    lifting: bool = field(default=True, kw_only=True)  # whether the robot may pass other postures between touches

    @property
    def cell(self) -> Cell:
        """The cell to be touched."""
        return self.prior.unknowns.cell

    @property
    def theta(self) -> Float[np.ndarray, " parameters"]:
        """The robot for which the touches are made [mm, rad]."""
        return self.prior.theta

    def with_candidates(self, candidates: Candidates) -> Self:
        """The same with other candidates, and the same coordinates."""
        other = replace(self, candidates=candidates)
        values = self.__dict__ | {"all_unknowns": self.all_unknowns}
        other.__dict__.update({name: value for name, value in values.items() if name in SHARED})
        return other

    @cached_property
    def zone(self) -> Float[np.ndarray, "poses joints"]:
        """Poses of the weld zone [rad] or [mm]."""
        return zone_poses(self.cell, self.theta)

    @cached_property
    def rows(self) -> Float[np.ndarray, "touches unknowns"]:
        """Whitened rows of all candidates, by all unknowns, each as much as the average robot is told."""
        return self.prior.unknowns.rows(self.candidates.expected_rows(self.cell), self.theta)

    @cached_property
    def tip(self) -> Float[np.ndarray, "poses 3 unknowns"]:
        """Rows of the tip at the poses of the zone [mm], by all unknowns."""
        return self.prior.unknowns.tip_rows(self.zone, self.theta)

    @cached_property
    def all_unknowns(self) -> Coordinates:
        """The coordinates of criteria for the weld zone."""
        return of_all_unknowns(self.prior, self.rows)

    @cached_property
    def identifiable(self) -> Coordinates:
        """The coordinates of criteria that compare with the literature."""
        return of_identifiable(self.prior)

    def coordinates(self, criterion: str | Criterion) -> Coordinates:
        """The coordinates of a criterion."""
        return self.all_unknowns if criterion_named(criterion).needs_zone else self.identifiable

    def rows_of(self, touches: Candidates) -> Float[np.ndarray, "touches unknowns"]:
        """Whitened rows of touches that all meet their faces, by all unknowns."""
        return self.prior.unknowns.rows(touches.rows(self.cell), self.theta)

    @cached_property
    def feasibility(self) -> Feasibility:
        """Who says whether a touch can be made."""
        return Feasibility(self.cell, self.theta, self.candidates.margins)

    @cached_property
    def edges(self) -> Edges:
        """Which ways between postures are clear, by as much as the tip may be off."""
        keep = SIGMAS * float(np.nanmax(self.candidates.margins.deviation))
        return Edges(self.feasibility.clearance, keep=keep, robots=self.prior.robots(ROBOTS, np.random.default_rng(0)))

    def spares_arms(self, touches: Candidates) -> Bool[np.ndarray, " touches"]:
        """Touches in which the arms of nearly all robots drawn from what is known hit nothing, to the search's end.

        A robot whose arm hits something in most of them is none that stands there, and does not count.
        """
        beyond = self.cell.touch.travel / self.cell.touch.approach  # where a search ends that meets nothing
        ends = (touches.approach, touches.q, touches.approach + beyond * (touches.q - touches.approach))
        hit = np.logical_or.reduce([self.edges.arm_hits(q) for q in ends])
        hit = hit[hit.mean(axis=1) <= MOST]
        return np.asarray(hit.sum(axis=0) <= RISK * ROBOTS)

    def visit(
        self,
        touches: Candidates,
        rng: np.random.Generator,
        kicks: int | None = None,
        *,
        start: Int[np.ndarray, " touches"] | None = None,
        above: Candidates | None = None,
    ) -> tuple[Order, Bool[np.ndarray, "touches touches"]]:
        """A short order of touches along clear ways, and which of them have ways to each other.

        The robot may pass postures `above` other touches, above these if not given.
        """
        return self._roadmap(touches if above is None else above).order(plan_of(touches), rng, kicks, start=start)

    def groups(self, touches: Candidates) -> Int[np.ndarray, " touches"]:
        """The group of each touch: there seem to be clear ways, over others, between all touches of a group.

        Group 0 is that of the posture in which the robot stands before the first touch.
        """
        return self._roadmap(touches).groups(touches.approach)

    def _roadmap(self, above: Candidates) -> Roadmap:
        if not self.lifting:
            return Roadmap(self.edges, np.empty((0, above.q.shape[1])))
        return Roadmap(self.edges, self._lifted(above), self._home)

    def _lifted(self, touches: Candidates) -> Float[np.ndarray, "lifted joints"]:
        """Postures above touches, each looked for once."""
        names = [q.tobytes() for q in touches.approach]
        new = np.array([i for i, name in enumerate(names) if name not in self._lifts], dtype=int)
        above = lifts(self.edges, touches.approach[new], touches.normal[new])
        self._lifts.update({names[i]: q for i, q in zip(new.tolist(), above, strict=True)})
        lifted = np.array([self._lifts[name] for name in names])
        return lifted[~np.isnan(lifted).any(axis=1)]

    @cached_property
    def _lifts(self) -> dict[bytes, np.ndarray]:
        """Postures above touches, by their approaches."""
        return {}

    @cached_property
    def _home(self) -> Float[np.ndarray, "homes joints"]:
        """Where the robot stands before the first touch, if that is clear."""
        return home(self.feasibility.clearance)

    def promise(self, touches: Candidates, times: float = 1.0, further: np.ndarray | None = None) -> Promise:
        """The tip error to expect in the zone after touches that are each made so many `times`.

        Whitened rows of `further` measurements, made after the touches, count with them. A touch that misses tells
        nothing: the promise is that over robots drawn from what is known, each of which misses others.
        """
        return self.searches(touches).promise(self._tip, times, None if further is None else self.prior.root(further))

    @cached_property
    def _tip(self) -> Float[np.ndarray, "poses 3 unknowns"]:
        """Rows of the tip at the poses of the zone, in units of the deviations that are known [mm]."""
        return self.prior.root(self.tip)

    def searches(self, touches: Candidates) -> Searches:
        """What robots drawn from what is known meet and learn with touches; the last sets are remembered."""
        name = touches.q.tobytes()
        result = self._searched.pop(name, None) or searches(self.prior, touches)
        for oldest in list(self._searched)[: max(0, len(self._searched) + 1 - REMEMBERED)]:
            del self._searched[oldest]
        self._searched[name] = result
        return result

    @cached_property
    def _searched(self) -> dict[bytes, Searches]:
        """By the postures at contact."""
        return {}

    def promise_of(self, points: Float[np.ndarray, "points 3 unknowns"], touches: Candidates) -> Promise:
        """The error to expect of points with these rows after touches, each of which is made until it hits."""
        return promise(TipErrors(self.prior.updated(self.rows_of(touches)).root(points)))

    def deviations(self, touches: Candidates) -> Float[np.ndarray, " touches"]:
        """How far each contact may be from where the touches before it predict it [mm, 1 sigma]."""
        B = self.prior.root(self.rows_of(touches))
        C, out = np.eye(B.shape[1]), np.empty(len(touches))
        for i, f in enumerate(B):
            x = C @ f
            out[i] = np.sqrt(f @ x + 1)
            C = C - np.outer(x, x) / (1 + f @ x)
        return out * self.cell.touch.sigma


def make_candidate_set(
    cell: Cell,
    rng: np.random.Generator,
    *,
    after: Calibration | None = None,
    count: int = COUNT,
    structured: bool = True,
    lifting: bool = True,
) -> CandidateSet:
    """Find what touches can be made, by what is known of the robot; `structured` ones, or only those spread evenly."""
    if after is not None:
        cell = _placed(cell, after)
    return around(prior_information(cell) if after is None else posterior(after, cell), rng, count, structured, lifting)


def around(
    prior: Information, rng: np.random.Generator, count: int = COUNT, structured: bool = True, lifting: bool = True
) -> CandidateSet:
    """Find what touches can be made by a robot of which so much is known."""
    share = STRUCTURED if structured else 0.0
    touches = candidates(
        prior.unknowns.cell, rng, count, theta=prior.theta, root=prior.parameter_root(), structured=share
    )
    return CandidateSet(prior, touches, lifting=lifting)


def _placed(cell: Cell, after: Calibration) -> Cell:
    """The cell with its base and tool where an earlier calibration found them, if the cell leaves that open.

    The joint errors that the touches chose then belong to the robot.
    """
    base = after.theta[:6] if cell.base is None else cell.base
    tool = after.theta[-6:] if cell.tool is None else cell.tool
    robot = cell.robot
    if robot.errors != after.cell.robot.errors:
        robot = robot.with_errors(after.cell.robot.errors)
    return replace(cell, robot=robot, base=base, tool=tool)


def plan_of(touches: Candidates, order: Int[np.ndarray, " touches"] | None = None) -> Plan:
    """Touches as they stand in plan.csv, numbered in their order."""
    touches = touches if order is None else touches.take(order)
    ids = tuple(str(i + 1) for i in range(len(touches)))
    return Plan(ids, touches.names(), touches.point, touches.normal, touches.q, touches.approach)
