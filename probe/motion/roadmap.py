"""Ways between touches that are clear: straight ones, or over other postures; and a short order along them.

A lazy probabilistic roadmap (Bohlin and Kavraki 2000): postures lifted from the jig, and those that the robot passes
anyway, joined by straight ways, each of which is looked at finely only where a shortest way uses it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.base_placement import parked
from identify.model.cell import Cell
from identify.model.ik import reach
from identify.model.touch import Plan
from probe.motion.clearance import CLEAR, MARGIN, Clearance
from probe.motion.edges import COARSE, Edges
from probe.motion.obstacles import obstacles
from probe.motion.tour import RAMP, Order, minutes, order, travel

LIFT = 40.0, 80.0  # [mm] that a lifted tip stands above its approach, or above all of the jig: at least and at most
RISKS = 0.0, 1.0  # share of the robots drawn from what is known whose arms may hit something, where ways are few
SEARCHES = 8  # rounds of looks before a way is given up
AHEAD = 6  # shortest ways that are looked at finely in one round
UNSEEN = 1.5  # times what a way takes, while nobody has looked whether it is clear
TURN = 2.0  # [rad], most that a joint turns on the way up: else the arm goes over into another branch


@dataclass(frozen=True, eq=False)
class Roadmap:
    """What the robot may do between touches: go straight where that is clear, or over postures in between."""

    edges: Edges
    stops: Float[np.ndarray, "stops joints"]  # postures that may be passed
    home: Float[np.ndarray, "homes joints"] | None = None  # where the robot stands before the first touch, if known

    @property
    def cell(self) -> Cell:
        """The cell in which the robot moves."""
        return self.edges.clearance.cell

    def route(
        self, start: Float[np.ndarray, " joints"], goal: Float[np.ndarray, " joints"], via: Sequence[np.ndarray] = ()
    ) -> list[Float[np.ndarray, " joints"]]:
        """Postures to go to one after the other: as planned, straight, or around; empty where no way was found.

        Ways that keep what the tip may be off come first, then those that keep the least that is safe.
        """
        for edges in (self.edges, *(replace(self.edges, keep=0.0, risk=risk) for risk in RISKS)):
            way = np.stack([start, *via, goal, start, goal])
            clear = edges.clear(np.delete(way[:-1], len(via) + 1, axis=0), np.delete(way[1:], len(via) + 1, axis=0))
            if clear[:-1].all():
                return [*via, goal]
            if clear[-1]:
                return [goal]
            if around := replace(self, edges=edges)._around(start, goal):
                return around
        return []

    def _around(
        self, start: Float[np.ndarray, " joints"], goal: Float[np.ndarray, " joints"]
    ) -> list[Float[np.ndarray, " joints"]]:
        """The shortest way over lifted postures and stops of which every leg is clear, those looked at preferred."""
        ends = np.stack([start, goal])
        up = lifts(self.edges, ends)
        q = np.concatenate([ends, up[~np.isnan(up).any(axis=1)], self.stops])
        near = len(q) - len(self.stops)
        a, b = (x.ravel() for x in np.meshgrid(np.arange(near), np.arange(len(q)), indexing="ij"))
        new = a < b
        a, b = a[new], b[new]
        D = UNSEEN * (travel(self.cell, q) + RAMP)
        D[a, b] = D[b, a] = np.where(self.edges.clear(q[a], q[b], COARSE), D[a, b] / UNSEEN, np.inf)
        sure = np.zeros(D.shape, dtype=bool)
        for _ in range(SEARCHES):
            ways = _next_ways(D, sure)
            if not ways:
                return []
            legs = np.array([leg for way in ways for leg in pairwise(way) if not sure[leg]], dtype=int)
            if not len(legs):
                return [q[i] for i in ways[0][1:]]
            a, b = legs.T
            fine = self.edges.clear(q[a], q[b])
            sure[a, b] = sure[b, a] = fine
            D[a, b] = D[b, a] = np.where(fine, D[a, b], np.inf)
        return []

    def order(
        self,
        plan: Plan,
        rng: np.random.Generator,
        kicks: int | None = None,
        *,
        start: Int[np.ndarray, " touches"] | None = None,
    ) -> tuple[Order, Bool[np.ndarray, "touches touches"]]:
        """A short order along clear ways, each looked at finely, and which touches have ways to each other.

        Never longer than `start`, nor blocked where that is not.
        """
        home = np.empty((0, plan.q.shape[1])) if self.home is None else self.home
        q = np.concatenate([plan.approach, self.stops, home])
        n, clear = len(plan), self.edges.among(q)
        sure, before = np.eye(len(q), dtype=bool), start
        while True:
            D, then = shortest_ways(np.where(clear, travel(self.cell, q) + RAMP, np.inf), n, n + len(self.stops))
            first = D[-1, :n] if len(home) else None
            tour, blocked = order(D[:n, :n], rng, first=first, start=before, kicks=kicks)
            before, kicks = tour if start is None else start, 0
            begin = [len(q) - 1] if first is not None and np.isfinite(first[tour[0]]) else []
            passed = _passed(then, [*begin, *tour.tolist()], len(begin) + blocked)
            legs = [leg for way in passed for leg in pairwise(way)]
            a, b = np.array(legs, dtype=int).reshape(-1, 2).T
            new = np.flatnonzero(~sure[a, b])
            fine = self.edges.between(q, a[new], b[new])
            sure[a[new], b[new]] = sure[b[new], a[new]] = True
            clear[a[new], b[new]] = clear[b[new], a[new]] = fine
            if fine.all():
                via = _vias(q, [way[1:-1] for way in passed], n, len(begin))
                placed = with_via(plan.take(tour), via)
                return Order(tour, via, minutes(self.cell, placed), tuple(blocked.tolist())), np.isfinite(D[:n, :n])

    def groups(self, approach: Float[np.ndarray, "touches joints"]) -> Int[np.ndarray, " touches"]:
        """The group of each touch, of those that ways connect which seem clear at a coarse look; 0 is that of home."""
        home = approach[:0] if self.home is None else self.home
        group = 1 + self.edges.groups(np.concatenate([approach, self.stops, home]))
        return np.asarray(np.where(len(home) and group == group[-1], 0, group)[: len(approach)])


def home(clearance: Clearance) -> Float[np.ndarray, "homes joints"]:
    """The parked posture of a cell, or all joints at zero, the first of them that is clear; none if neither is."""
    robot = clearance.cell.robot
    q = np.stack([parked(clearance.cell), np.clip(np.zeros(len(robot.joints)), robot.lower, robot.upper)])
    return q[clearance.hits(q) == CLEAR][:1]


def with_via(plan: Plan, via: Float[np.ndarray, "touches vias joints"]) -> Plan:
    """A plan with other postures on its ways."""
    return Plan(plan.ids, plan.face, plan.point, plan.normal, plan.q, plan.approach, via)


def _next_ways(
    D: Float[np.ndarray, "postures postures"], sure: Bool[np.ndarray, "postures postures"]
) -> list[list[int]]:
    """The shortest way from posture 0 to posture 1, and those that would follow if its legs that are not sure fail.

    As many as are looked at together; only the first where all its legs are sure.
    """
    from scipy.sparse.csgraph import csgraph_from_dense, dijkstra

    ways, rest = list[list[int]](), D.copy()
    while len(ways) < AHEAD:
        graph = csgraph_from_dense(rest, null_value=np.inf)
        distance, before = dijkstra(graph, directed=False, indices=np.array([0]), return_predecessors=True)
        if not np.isfinite(distance[0, 1]):
            break
        way = [1]
        while way[0] != 0:
            way.insert(0, int(before[0, way[0]]))
        ways.append(way)
        a, b = np.array([leg for leg in pairwise(way) if not sure[leg]], dtype=int).reshape(-1, 2).T
        if not len(a):
            break
        rest[a, b] = rest[b, a] = np.inf
    return ways


def shortest_ways(
    T: Float[np.ndarray, "postures postures"], begin: int, end: int
) -> tuple[Float[np.ndarray, "postures postures"], Int[np.ndarray, "postures postures"]]:
    """The shortest times between postures over those from `begin` to `end`, and what to pass next (Floyd 1962)."""
    then = np.tile(np.arange(len(T)), (len(T), 1))
    np.fill_diagonal(T, 0.0)
    for k in range(begin, end):
        over = T[:, k : k + 1] + T[k]
        better = over < T - 1e-9
        T, then = np.where(better, over, T), np.where(better, then[:, k : k + 1], then)
    return T, then


def lifts(
    edges: Edges, q: Float[np.ndarray, "postures joints"], normal: Float[np.ndarray, "postures 3"] | None = None
) -> Float[np.ndarray, "postures joints"]:
    """Postures above others, the wire as it stands there; NaN where there is none.

    Over all of the jig, or else off the face along its `normal`, or along the wire where that is not given.
    """
    cell, theta = edges.clearance.cell, edges.clearance.theta
    height, joints = float(np.clip(edges.keep, *LIFT)), len(cell.robot.joints)
    top = max((solid.top for solid in obstacles(cell.jig)), default=-np.inf) + height if cell.jig else -np.inf
    tip, R = cell.kinematics.tip(q, theta)
    over = np.column_stack([tip[:, :2], np.maximum(tip[:, 2] + height, top)])
    lifted = np.full_like(q, np.nan)
    for to in (over, tip + height * (-R[:, :, 2] if normal is None else normal)):
        rest = np.flatnonzero(np.isnan(lifted).any(axis=1))
        solved = reach(
            cell.kinematics, theta, to[rest], R[rest], q[rest], free_roll=joints == 5, free_orientation=joints < 5
        )
        turn = np.where(cell.robot.prismatic, 0.0, np.abs(solved.q - q[rest])).max(axis=1, initial=0.0)
        ok = np.flatnonzero(solved.reached(1.0) & (turn < TURN))
        ok = ok[edges.clearance.hits(solved.q[ok], margin=MARGIN) == CLEAR]
        lifted[rest[ok]] = solved.q[ok]
    return lifted


def _passed(
    then: Int[np.ndarray, "postures postures"], path: list[int], blocked: Int[np.ndarray, " places"]
) -> list[list[int]]:
    """The postures of every way of a path, both ends included; of a blocked way only the end."""
    out = []
    for k, (a, b) in enumerate(pairwise(path)):
        way = [b] if k in blocked else [a]
        while way[-1] != b:
            way.append(int(then[way[-1], b]))
        out.append(way)
    return out


def _vias(
    q: Float[np.ndarray, "postures joints"], passed: list[list[int]], n: int, from_home: int
) -> Float[np.ndarray, "n vias joints"]:
    """Postures between the ends of ways, as a plan has them: those to its first touch only if it is known."""
    ways = passed if from_home else [[], *passed]
    via = np.full((n, max((len(way) for way in ways), default=0), q.shape[1]), np.nan)
    for i, way in enumerate(ways):
        via[i, : len(way)] = q[way]
    return via
