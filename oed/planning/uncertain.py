"""Touches for a badly known robot: chosen quickly, and visited on ways that are clear for nearly all that it may be."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import shortest_path

from identify.model.cell import Cell
from identify.model.io.calibration_file import Calibration
from identify.model.touch import Plan
from oed.planning.candidate_set import CandidateSet, make_candidate_set, plan_of
from oed.planning.visitable import Best, visited
from probe.motion.edges import FINE, POINTS, ROBOTS, Edges
from probe.motion.roadmap import with_via
from probe.motion.torch import STICKOUT
from probe.motion.tour import between

ROUGH = 3000  # candidates: what is believed of the robot is not worth more care yet
RISKS = (0.0, 0.1, 0.3, 1.0)  # share of them that may hit the jig on a way, the least that lets an order be found
LOOKS = 1000  # at places, for an order
ROOM = 3.0  # [mm], between wire and jig


@dataclass(frozen=True, eq=False)
class UncertainEdges(Edges):
    """Edges on which the wire of nearly all robots stays out of the solid boxes."""

    def clear(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"], step: float = FINE
    ) -> Bool[np.ndarray, " ways"]:
        """As the usual ways are, and for nearly all robots."""
        ok = super().clear(start, end, step)
        some = np.flatnonzero(ok)
        ok[some] = self._wire_spared(start[some], end[some])
        return ok

    def _wire_spared(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"]
    ) -> Bool[np.ndarray, " ways"]:
        """Ways on which no more than the allowed share of the robots hit the jig."""
        robots = () if self.robots is None or self.risk >= 1.0 else self.robots
        cell, most = self.clearance.cell, self.risk * len(robots)
        q, hits = between(start, end, POINTS), np.zeros(len(start))
        for theta in robots:
            rest = np.flatnonzero(hits <= most)
            tip, R = cell.kinematics.tip(q[rest].reshape(-1, q.shape[2]), theta)
            inside = np.zeros(len(tip), dtype=bool)
            for point in (tip, tip - STICKOUT / 2 * R[:, :, 2]):
                inside |= self.clearance.segments_near(point.T, point.T, np.full(len(point), ROOM))
            hits[rest] += inside.reshape(len(rest), POINTS).any(axis=1)
        return hits <= most


@dataclass(frozen=True, eq=False)
class UncertainCandidateSet(CandidateSet):
    """Candidates between which ways are clear for nearly all robots that what is known allows."""

    risk: float = 1.0

    @cached_property
    def edges(self) -> UncertainEdges:
        """Which ways between postures are clear."""
        robots = self.prior.robots(ROBOTS, np.random.default_rng(0))
        return UncertainEdges(self.feasibility.clearance, robots=robots, risk=self.risk)


def plan_under_uncertainty(
    cell: Cell, n: int, rng: np.random.Generator, after: Calibration | None = None, trail: Plan | None = None
) -> Plan:
    """A plan for a badly known robot, that begins with a clear way from the last touch of a trail."""
    start = make_candidate_set(cell, rng, after=after, count=ROUGH)
    for risk in RISKS:
        candidate_set = UncertainCandidateSet(start.prior, start.candidates, risk, lifting=False)
        order = visited(candidate_set, Best(candidate_set, n, "V"), rng).order
        plan = plan_of(candidate_set.candidates.take(order.index))
        started = begun(plan, candidate_set.edges, trail)
        if not order.blocked and (trail is None or started is not plan):
            return started
    return in_reach(started, candidate_set.edges)


def in_reach(plan: Plan, edges: Edges) -> Plan:
    """The touches of a plan that clear ways lead to, each from the one before: the others are given up."""
    path = [0]
    for k in range(1, len(plan)):
        if edges.clear(plan.approach[path[-1:]], plan.approach[[k]])[0]:
            path.append(k)
    return plan.take(np.array(path))


def begun(plan: Plan, edges: Edges, trail: Plan | None) -> Plan:
    """The plan in an order that begins with a clear way from the last touch of a trail, where the robot stands.

    Where there is none, the robot goes back first the way that it has come, until one leads on. The plan itself is
    returned where none does.
    """
    if trail is None:
        return plan
    for back in _retreats(trail.approach[::-1], edges):
        start = back[-1:] if len(back) else trail.approach[-1:]
        for anew in (False, True):
            if (order := _from(start, plan.approach, edges, anew)) is not None:
                return _over(plan.take(order), back)
    return plan


def _retreats(
    been: Float[np.ndarray, "touches joints"], edges: Edges
) -> Iterator[Float[np.ndarray, "postures joints"]]:
    """None, and then the shortest ways back to where the robot has been, the last place first."""
    yield been[:0]
    if len(been) < 2:
        return
    clear = edges.among(been)
    clear |= np.abs(np.subtract.outer(np.arange(len(been)), np.arange(len(been)))) == 1  # it has come that way
    hops, before = shortest_path(clear, directed=False, unweighted=True, return_predecessors=True, indices=0)
    for k in np.argsort(hops, kind="stable")[1:]:
        way = [int(k)]
        while before[way[0]] != 0:
            way.insert(0, int(before[way[0]]))
        yield been[way]


def _over(plan: Plan, back: Float[np.ndarray, "postures joints"]) -> Plan:
    """The plan whose first touch is reached over some postures."""
    if not len(back):
        return plan
    wide = max(plan.via.shape[1], len(back))
    via = np.full((len(plan), wide, plan.q.shape[1]), np.nan)
    via[:, : plan.via.shape[1]] = plan.via
    via[0], via[0, : len(back)] = np.nan, back
    return with_via(plan, via)


def _from(
    start: Float[np.ndarray, "1 joints"], at: Float[np.ndarray, "touches joints"], edges: Edges, anew: bool
) -> Int[np.ndarray, " touches"] | None:
    """An order with clear ways from a start: one found anew, or the one that is there, or its reverse."""
    places = np.vstack([start, at])
    if anew:
        walk = _walk(edges.among(places), np.abs(places[:, None] - places[None]).max(axis=2))
        return None if walk is None else np.array(walk[1:]) - 1
    if not edges.clear(at[:-1], at[1:]).all():
        return None
    first, last = edges.clear(np.vstack([start, start]), at[[0, -1]])
    index = np.arange(len(at))
    return index if first else index[::-1] if last else None


def _walk(clear: Bool[np.ndarray, "places places"], far: Float[np.ndarray, "places places"]) -> list[int] | None:
    """A way through all places from the first, by clear ways, the nearest first; None where none is found soon.

    A place with one clear way left is taken before all others, so that few steps are taken back.
    """
    way, stack = [0], [_next(clear, far, [0])]
    for _ in range(LOOKS):
        if len(way) == len(clear):
            return way
        if stack[-1]:
            way.append(stack[-1].pop(0))
            stack.append(_next(clear, far, way))
        elif len(way) > 1:
            way.pop()
            stack.pop()
        else:
            return None
    return None


def _next(
    clear: Bool[np.ndarray, "places places"], far: Float[np.ndarray, "places places"], way: list[int]
) -> list[int]:
    """Places not visited yet that a clear way leads to, in the order in which to try them."""
    open_ = np.setdiff1d(np.arange(len(clear)), way)
    ways = clear[np.ix_(open_, open_)].sum(axis=1)
    order = np.lexsort((far[way[-1], open_], ways > 1))
    return [int(k) for k in open_[order] if clear[way[-1], k]]
