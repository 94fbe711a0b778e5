"""What a plan is chosen from: all touches that can be made, what each would tell, and the zone where it counts."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.io.calibration_file import Calibration
from identify.model.touch import Plan
from identify.model.zone import zone_poses
from identify.uncertainty.knowledge import (
    Knowledge,
    built_knowledge,
    knowledge_after,
    nominal_knowledge,
    tip_errors,
    touch_sigma,
)
from identify.uncertainty.promise import Promise, promise
from oed.candidates.candidates import COUNT, STRUCTURED, Candidates, candidates
from oed.candidates.edge_margins import SIGMAS
from oed.candidates.feasibility import Feasibility
from probe.motion.clearance import CLEAR
from probe.motion.edges import Edges
from probe.motion.roadmap import Roadmap, lifts
from probe.motion.tour import Order


@dataclass(frozen=True, eq=False)
class Offer:
    """Touches on offer, and what is known before them."""

    known: Knowledge  # by which touches are chosen
    found: Candidates
    drawing: Knowledge | None = field(default=None, kw_only=True)  # by which indices are told; None: the same
    told: Knowledge | None = field(default=None, kw_only=True)  # by which is told what they will bring; None: the same
    lifting: bool = field(default=True, kw_only=True)  # whether the robot may pass other postures between touches

    @cached_property
    def sigma(self) -> Float[np.ndarray, " touches"]:
        """Standard deviation of every touch [mm]."""
        return touch_sigma(self.known.cell, self.found.names())

    @cached_property
    def rows(self) -> Float[np.ndarray, "touches kept"]:
        """What every touch tells, whitened."""
        return self.rows_at(self.known.typical)

    def rows_at(self, theta: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, "touches kept"]:
        """What every touch would tell of a robot with other parameters."""
        return self.known.rows(self.found.q, self.found.normal, self.sigma, theta, self.found.approach)

    @cached_property
    def zone(self) -> Float[np.ndarray, "poses joints"]:
        """Poses of the weld zone [rad] or [mm]."""
        return zone_poses(self.known.cell, self.known.theta)

    @cached_property
    def tip(self) -> Float[np.ndarray, "poses 3 kept"]:
        """How the tip moves there with the whitened parameters [mm]."""
        return self.known.tip_rows(self.zone)

    @cached_property
    def feasibility(self) -> Feasibility:
        """Who says whether a touch can be made."""
        return Feasibility(self.known.cell, self.known.theta, self.found.margins)

    @cached_property
    def edges(self) -> Edges:
        """Which ways between postures are clear, by as much as the tip may be off."""
        return Edges(self.feasibility.clearance, keep=SIGMAS * float(np.nanmax(self.found.margins.deviation)))

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
        """The group of each touch: there seem to be clear ways, over others, between all touches of a group."""
        return self._roadmap(touches).groups(touches.approach)

    def _roadmap(self, above: Candidates) -> Roadmap:
        if not self.lifting:
            return Roadmap(self.edges, np.empty((0, above.q.shape[1])))
        return Roadmap(self.edges, self._lifted(above), self._home)

    def _lifted(self, touches: Candidates) -> Float[np.ndarray, "lifted joints"]:
        """Postures above touches, each looked for once."""
        names = [q.tobytes() for q in touches.approach]
        new = np.array([i for i, name in enumerate(names) if name not in self._lifts], dtype=int)
        found = lifts(self.edges, touches.approach[new], touches.normal[new])
        self._lifts.update({names[i]: q for i, q in zip(new.tolist(), found, strict=True)})
        lifted = np.array([self._lifts[name] for name in names])
        return lifted[~np.isnan(lifted).any(axis=1)]

    @cached_property
    def _lifts(self) -> dict[bytes, np.ndarray]:
        """Postures above touches, by their approaches."""
        return {}

    @cached_property
    def _home(self) -> Float[np.ndarray, "homes joints"]:
        """All joints at zero, as far as the limits let them, if nothing is in the way there."""
        robot = self.known.cell.robot
        home = np.clip(np.zeros((1, len(robot.joints))), robot.lower, robot.upper)
        return home[self.feasibility.clearance.hits(home) == CLEAR]

    def promise(self, touches: Candidates, times: float = 1.0) -> Promise:
        """The tip error to expect in the zone after some touches, each made so many `times`."""
        told, names = self.told or self.known, touches.names()
        rows = told.rows(touches.q, touches.normal, touch_sigma(told.cell, names), approach=touches.approach)
        return promise(tip_errors(self._told_tip, told.error(rows, names, times)))

    def off(self, touches: Candidates) -> Float[np.ndarray, " touches"]:
        """How far each contact may be from where the touches before it predict it [mm, 1 sigma]."""
        told = self.told or self.known
        sigma = touch_sigma(told.cell, touches.names())
        C, out = np.linalg.inv(told.precision), np.empty(len(touches))
        for i, f in enumerate(told.rows(touches.q, touches.normal, sigma)):
            x = C @ f
            out[i] = np.sqrt(f @ x + 1)
            C = C - np.outer(x, x) / (1 + f @ x)
        return out * sigma

    @cached_property
    def _told_tip(self) -> Float[np.ndarray, "poses 3 kept"]:
        return self.tip if self.told is None else self.told.tip_rows(self.zone)


def offer(
    cell: Cell,
    rng: np.random.Generator,
    *,
    after: Calibration | None = None,
    count: int = COUNT,
    structured: bool = True,
    lifting: bool = True,
    built: bool = False,
) -> Offer:
    """Find what touches can be made, by what is known of the robot; `structured` ones, or only those spread evenly.

    With `built`, touches are chosen for a robot as it may be built, and not for the drawing.
    """
    if after is not None:
        cell = _placed(cell, after)
    known = nominal_knowledge(cell) if after is None else knowledge_after(cell, after)
    share = STRUCTURED if structured else 0.0
    found = candidates(cell, rng, count, theta=known.theta, covariance=known.deviation, structured=share)
    if after is not None:
        return Offer(known, found, lifting=lifting)
    told = built_knowledge(cell)
    return Offer(told if built else known, found, drawing=known, told=told, lifting=lifting)


def _placed(cell: Cell, after: Calibration) -> Cell:
    """The cell with its base and tool where an earlier calibration found them, if the cell leaves that open.

    The joint errors that the touches chose then belong to the robot.
    """
    base = after.theta[:6] if cell.base is None else cell.base
    tool = after.theta[-6:] if cell.tool is None else cell.tool
    robot = cell.robot
    if robot.errors != after.cell.robot.errors:
        robot = replace(robot, errors=after.cell.robot.errors, error_values=())
    return replace(cell, robot=robot, base=base, tool=tool)


def plan_of(touches: Candidates, order: Int[np.ndarray, " touches"] | None = None) -> Plan:
    """Touches as they stand in plan.csv, numbered in their order."""
    touches = touches if order is None else touches.take(order)
    ids = tuple(str(i + 1) for i in range(len(touches)))
    return Plan(ids, touches.names(), touches.point, touches.normal, touches.q, touches.approach)
