"""A short order of touches along clear ways: straight ones, or over postures lifted from the jig."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.ik import reach
from identify.model.touch import Plan
from probe.motion.clearance import CLEAR, MARGIN
from probe.motion.edges import Edges, components
from probe.motion.tour import RAMP, Order, minutes, order, travel

LIFT = 40.0, 80.0  # [mm] that a lifted tip stands above its approach, or above all of the jig: at least and at most
TURN = 2.0  # [rad], most that a joint turns on the way up: else the arm goes over into another branch


@dataclass(frozen=True, eq=False)
class Roadmap:
    """What the robot may do between touches: go straight where that is clear, or over postures in between."""

    edges: Edges
    cell: Cell
    lifted: Float[np.ndarray, "lifted joints"]  # postures that may be passed
    home: Float[np.ndarray, "homes joints"]  # where the robot stands before the first touch, if that is known

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
        q = np.concatenate([plan.approach, self.lifted, self.home])
        n, clear = len(plan), self.edges.among(q)
        sure, before = np.eye(len(q), dtype=bool), start
        while True:
            D, then = shortest_ways(np.where(clear, travel(self.cell, q) + RAMP, np.inf), n, n + len(self.lifted))
            first = D[-1, :n] if len(self.home) else None
            tour, blocked = order(D[:n, :n], rng, first=first, start=before, kicks=kicks)
            before, kicks = tour if start is None else start, 0
            begin = [len(q) - 1] if first is not None and np.isfinite(first[tour[0]]) else []
            passed = _passed(then, [*begin, *tour.tolist()], len(begin) + blocked)
            legs = [leg for way in passed for leg in pairwise(way)]
            a, b = np.array(legs, dtype=int).reshape(-1, 2).T
            new = np.flatnonzero(~sure[a, b])
            fine = self.edges.clear(q[a[new]], q[b[new]])
            sure[a[new], b[new]] = sure[b[new], a[new]] = True
            clear[a[new], b[new]] = clear[b[new], a[new]] = fine
            if fine.all():
                via = _vias(q, [way[1:-1] for way in passed], n, len(begin))
                placed = with_via(plan.take(tour), via)
                return Order(tour, via, minutes(self.cell, placed), tuple(blocked.tolist())), np.isfinite(D[:n, :n])

    def groups(self, approach: Float[np.ndarray, "touches joints"]) -> Int[np.ndarray, " touches"]:
        """The group of each touch, of those that ways connect which seem clear at a coarse look."""
        return components(self.edges.among(np.concatenate([approach, self.lifted, self.home])))[: len(approach)]


def with_via(plan: Plan, via: Float[np.ndarray, "touches vias joints"]) -> Plan:
    """A plan with other postures on its ways."""
    return Plan(plan.ids, plan.face, plan.point, plan.normal, plan.q, plan.approach, via)


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
    edges: Edges, cell: Cell, approach: Float[np.ndarray, "touches joints"], normal: Float[np.ndarray, "touches 3"]
) -> Float[np.ndarray, "touches joints"]:
    """Postures above the approaches of touches, the wire as it stands there; NaN where there is none.

    Over all of the jig, or else off the face.
    """
    theta, boxes = edges.clearance.theta, () if cell.jig is None else cell.jig.boxes
    height, joints = float(np.clip(edges.keep, *LIFT)), len(cell.robot.joints)
    top = max((box.upper[2] for box in boxes), default=-np.inf) + height
    tip, R = cell.kinematics.tip(approach, theta)
    over = np.column_stack([tip[:, :2], np.maximum(tip[:, 2] + height, top)])
    lifted = np.full_like(approach, np.nan)
    for to in (over, tip + height * normal):
        left = np.flatnonzero(np.isnan(lifted).any(axis=1))
        found = reach(
            cell.kinematics,
            theta,
            to[left],
            R[left],
            approach[left],
            free_roll=joints == 5,
            free_orientation=joints < 5,
        )
        turn = np.where(cell.robot.prismatic, 0.0, np.abs(found.q - approach[left])).max(axis=1, initial=0.0)
        ok = np.flatnonzero(found.reached(1.0) & (turn < TURN))
        ok = ok[edges.clearance.hits(found.q[ok], margin=MARGIN) == CLEAR]
        lifted[left[ok]] = found.q[ok]
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
    q: Float[np.ndarray, "postures joints"], passed: list[list[int]], n: int, begun: int
) -> Float[np.ndarray, "n vias joints"]:
    """Postures between the ends of ways, as a plan has them: those to its first touch only if it is known."""
    ways = passed if begun else [[], *passed]
    via = np.full((n, max((len(way) for way in ways), default=0), q.shape[1]), np.nan)
    for i, way in enumerate(ways):
        via[i, : len(way)] = q[way]
    return via
