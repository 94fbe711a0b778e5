"""Straight ways in joint space between postures: whether arm, torch and wire keep clear of the jig on them."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.ik_step import LEVER
from probe.motion.clearance import CLEAR, MARGIN, WIRE, Clearance
from probe.motion.torch import STICKOUT
from probe.motion.tour import between

COARSE = 0.2  # [rad] a joint may turn between two postures that are looked at, of ways that could be taken
FINE = 0.03  # [rad], of ways that are taken
SHARE = 0.8  # of the distance that the nearer end of a way has, which the way keeps where it cannot keep more
SPACING = 3.0  # [mm] that a point of arm or torch moves between two looks, at the least
AT_ONCE = 4  # ways a posture that are looked at together, where only groups are asked for
INTERVALS = 8  # of a way, for how far such points move on it
ROBOTS = 24  # drawn from what is known
POINTS = 33  # of a way, at which they are looked at


@dataclass(frozen=True, eq=False)
class Edges:
    """Which straight ways in joint space are clear, by as much as the tip may be off.

    A way keeps `keep` from the jig, or most of what both its ends have, and never less than half of MARGIN (arm and
    torch) and WIRE where its ends have that: the margin comes from what is known of the robot, and ends where there
    would be no way left. On a way that is taken, the arms of no more than a share `risk` of `robots`, which may be the
    real one, hit anything.
    """

    clearance: Clearance
    keep: float = field(default=0.0, kw_only=True)  # [mm]
    robots: Float[np.ndarray, "robots parameters"] | None = field(default=None, kw_only=True)
    risk: float = field(default=0.0, kw_only=True)

    def at(
        self,
        theta: Float[np.ndarray, " parameters"],
        keep: float,
        robots: Float[np.ndarray, "robots parameters"] | None = None,
    ) -> "Edges":
        """The ways of a robot with other parameters, whose tip may be off by another amount."""
        return replace(self, clearance=self.clearance.at(theta), keep=keep, robots=robots)

    def clear(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"], step: float = FINE
    ) -> Bool[np.ndarray, " ways"]:
        """Ways on which arm and torch keep their margin, and the bare wire, between looks too, its own."""
        if not len(start):
            return np.ones(0, dtype=bool)
        arm, inside, wire = self._margins(start, end)
        ok = (arm > 0) & (inside > 0) & (wire > 0)
        some = np.flatnonzero(ok)
        owner, q = self._postures(start[some], end[some], step, arm[some])
        owner = some[owner]
        ok[owner[self._wire_near(owner, q, wire)]] = False
        rest = np.flatnonzero(ok[owner])
        on = owner[rest]
        ok[on[self.clearance.hits(q[rest], margin=arm[on], inside=inside[on]) != CLEAR]] = False
        if step <= FINE and self.robots is not None and self.risk < 1.0:
            some = np.flatnonzero(ok)
            ok[some] = self._spared(start[some], end[some])
        return ok

    def _spared(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"]
    ) -> Bool[np.ndarray, " ways"]:
        """Ways on which few enough arms hit an obstacle between two ends at which they do not."""
        q = between(start, end, POINTS)
        hit = self.arm_hits(q.reshape(-1, q.shape[2])).reshape(len(self._arms), len(q), POINTS)
        new = hit.any(axis=2) & ~hit[:, :, 0] & ~hit[:, :, -1]
        return np.asarray(new.sum(axis=0) <= self.risk * len(hit))

    def arm_hits(self, q: Float[np.ndarray, "postures joints"]) -> Bool[np.ndarray, "robots postures"]:
        """In which postures the arm of which robot that may be the real one hits an obstacle."""
        hit = [arm.hits(q, margin=0.0) != CLEAR for arm in self._arms]
        return np.array(hit, dtype=bool).reshape(len(hit), len(q))

    @cached_property
    def _arms(self) -> list[Clearance]:
        """The arms of all these robots."""
        return [self.clearance.at(theta).arm for theta in (() if self.robots is None else self.robots)]

    def among(self, q: Float[np.ndarray, "poses joints"]) -> Bool[np.ndarray, "poses poses"]:
        """Ways between every two poses that seem clear at a coarse look."""
        a, b = np.triu_indices(len(q), 1)
        out = np.eye(len(q), dtype=bool)
        out[a, b] = out[b, a] = self.between(q, a, b, COARSE)
        return out

    def groups(self, q: Float[np.ndarray, "poses joints"]) -> Int[np.ndarray, " poses"]:
        """The group of each posture: those that ways connect which seem clear at a coarse look.

        Short ways come first, and a way between two postures of one group is not looked at.
        """
        a, b = np.triu_indices(len(q), 1)
        D = np.abs((q[a] - q[b]) / self.clearance.cell.robot.speed).max(axis=1, initial=0.0)
        rest, clear = np.argsort(D, kind="stable"), np.zeros((len(q), len(q)), dtype=bool)
        group = components(clear)
        while len(rest := rest[group[a[rest]] != group[b[rest]]]):
            some, rest = rest[: AT_ONCE * len(q)], rest[AT_ONCE * len(q) :]
            clear[a[some], b[some]] = self.between(q, a[some], b[some], COARSE)
            group = components(clear)
        return group

    def between(
        self,
        q: Float[np.ndarray, "poses joints"],
        a: Int[np.ndarray, " ways"],
        b: Int[np.ndarray, " ways"],
        step: float = FINE,
    ) -> Bool[np.ndarray, " ways"]:
        """Which ways between two of some postures are clear; each is looked at once."""
        name, memory = [row.tobytes() for row in q], self._seen[step]
        pairs = [frozenset((name[i], name[j])) for i, j in zip(a.tolist(), b.tolist(), strict=True)]
        new = np.array([k for k, pair in enumerate(pairs) if pair not in memory], dtype=int)
        memory.update(zip((pairs[k] for k in new), self.clear(q[a[new]], q[b[new]], step).tolist(), strict=True))
        return np.array([memory[pair] for pair in pairs], dtype=bool)

    @cached_property
    def _seen(self) -> dict[float, dict[frozenset[bytes], bool]]:
        """Ways that were looked at, by how closely and by both their ends."""
        return {COARSE: {}, FINE: {}}

    def _margins(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"]
    ) -> tuple[Float[np.ndarray, " ways"], Float[np.ndarray, " ways"], Float[np.ndarray, " ways"]]:
        """What arm and torch keep from obstacles and from each other, and what the bare wire keeps [mm].

        Not above 0 where one of the ends has nothing to keep.
        """
        nearer = np.minimum(self._gaps(start), self._gaps(end)).T
        most = max(self.keep, MARGIN / 2), min(max(self.keep, MARGIN / 2), MARGIN), max(self.keep, WIRE)
        nodes = [np.minimum(SHARE * gap, limit) for gap, limit in zip(nearer, most, strict=True)]
        return nodes[0], nodes[1], nodes[2]

    def _gaps(self, q: Float[np.ndarray, "postures joints"]) -> Float[np.ndarray, "postures 3"]:
        """Distances of arm and torch from obstacles and from each other, and of the bare wire; remembered [mm]."""
        names = [row.tobytes() for row in q]
        new = {name: row for name, row in zip(names, q, strict=True) if name not in self._remembered}
        if new:
            some = np.stack(list(new.values()))
            wire = self.clearance.segment_gaps(*self.clearance.wire(some), max(self.keep, WIRE) / SHARE)
            gaps = np.column_stack([*self.clearance.gaps(some, max(self.keep, MARGIN) / SHARE), wire])
            self._remembered.update(zip(new, gaps, strict=True))
        return np.stack([self._remembered[name] for name in names])

    @cached_property
    def _remembered(self) -> dict[bytes, Float[np.ndarray, " gaps"]]:
        """What ends of ways that were looked at keep."""
        return {}

    def _postures(
        self,
        start: Float[np.ndarray, "ways joints"],
        end: Float[np.ndarray, "ways joints"],
        step: float,
        margin: Float[np.ndarray, " ways"],
    ) -> tuple[Int[np.ndarray, " postures"], Float[np.ndarray, "postures joints"]]:
        """Postures along ways, no farther apart than `step`, ends included; and the way that each is on.

        At a fine look no point of arm or torch moves more than twice the margin in between: it then never hits.
        """
        unit = np.where(self.clearance.cell.robot.prismatic, LEVER, 1.0)
        count = 1 + np.ceil(np.maximum(np.abs((end - start) / unit).max(axis=1, initial=0.0) / step, 1)).astype(int)
        if step <= FINE and len(start):
            fastest = INTERVALS * self._travel(start, end)  # [mm] on a whole way
            count = np.maximum(count, 1 + np.ceil(fastest / np.maximum(1.9 * margin, SPACING)).astype(int))
        owner = np.repeat(np.arange(len(start)), count)
        place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        s = place / (count[owner] - 1)
        return owner, start[owner] + s[:, None] * (end - start)[owner]

    def _travel(
        self, start: Float[np.ndarray, "ways joints"], end: Float[np.ndarray, "ways joints"]
    ) -> Float[np.ndarray, " ways"]:
        """The most that a point of arm or torch moves on one of INTERVALS equal parts of each way [mm]."""
        q = between(start, end, INTERVALS + 1)
        move = np.zeros(len(start))
        for ends in self.clearance.ends(q.reshape(-1, q.shape[2])):
            p = ends.reshape(3, ends.shape[1], len(start), INTERVALS + 1)
            if p.size:
                move = np.maximum(move, np.sqrt((np.diff(p, axis=3) ** 2).sum(axis=0)).max(axis=(0, 2)))
        return move

    def _wire_near(
        self,
        owner: Int[np.ndarray, " postures"],
        q: Float[np.ndarray, "postures joints"],
        margin: Float[np.ndarray, " ways"],
    ) -> Bool[np.ndarray, " postures"]:
        """Postures from which tip or middle of the bare wire come too near to an obstacle before the next one."""
        tip, R = self.clearance.cell.kinematics.tip(q, self.clearance.theta)
        near, going = np.zeros(len(q), dtype=bool), owner[1:] == owner[:-1]
        need = margin[owner[:-1][going]]
        for point in (tip, tip - STICKOUT / 2 * R[:, :, 2]):
            near[:-1][going] |= self.clearance.segments_near(point[:-1][going].T, point[1:][going].T, need)
        return near


def astray(clear: Bool[np.ndarray, "touches touches"], blocked: Int[np.ndarray, "ways 2"]) -> Int[np.ndarray, " some"]:
    """Touches to give up so that an order without blocked ways may be found.

    Those outside the largest group that clear ways connect, and, of each blocked way of the order, the end with fewer
    clear ways. `blocked` holds the touches at both ends of each.
    """
    group = components(clear)
    main = np.argmax(np.bincount(group))
    outside = np.flatnonzero(group != main)
    degree = clear.sum(axis=1)
    ends = [int(min(pair, key=lambda i: (degree[i], i))) for pair in blocked.reshape(-1, 2)]
    return np.unique(np.concatenate([outside, np.array(ends, dtype=int)]))


def components(clear: Bool[np.ndarray, "touches touches"]) -> Int[np.ndarray, " touches"]:
    """The group of each touch: those that clear ways connect, directly or through others, share one."""
    from scipy.sparse.csgraph import connected_components

    return np.asarray(connected_components(clear, directed=False)[1])


def like(
    cell: Cell,
    some: Float[np.ndarray, "some joints"],
    bad: Float[np.ndarray, "bad joints"],
    good: Float[np.ndarray, "good joints"],
) -> Bool[np.ndarray, " some"]:
    """Poses that are nearer to a bad one than to any good one, by the time that joints take."""
    speed = cell.robot.speed[:, None]
    columns = some.T / speed

    def nearest(to: np.ndarray) -> np.ndarray:
        out = np.full(len(some), np.inf)
        for q in to[:, :, None] / speed:
            np.minimum(out, np.abs(columns - q).max(axis=0), out=out)
        return out

    return nearest(bad) < nearest(good)
