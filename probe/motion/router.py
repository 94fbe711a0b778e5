"""Ways of the tip between approach points that keep out of the jig, by what the touches so far tell of the robot."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from probe.motion.joint_path import STEP, Geometry

NEAR = 4.0  # [mm] from the jig that a way may come; planners keep a little more
CLEAR = 15.0  # [mm], on ways that no planner has seen
UNPLANNED = 300.0  # [mm] that a way may be longer for being one that the plan goes along, too

Joints = Float[np.ndarray, " joints"]


class Ways:
    """Straight ways in joint space from here to an approach, or round about over others."""

    def __init__(self, geometry: Geometry, stops: Sequence[Joints]) -> None:
        self.geometry = geometry
        self.theta = geometry.cell.theta  # the most probable parameters, as far as touches tell them
        self._stops = np.stack(stops)  # approach points and those on the way to them, in the order of the plan

    def route(self, start: Joints, goal: Joints, via: Sequence[Joints] = ()) -> list[Joints]:
        """Where to go one after the other: as planned, straight or around; empty where the jig is in the way of all."""
        for planned in ([*via, goal], [goal]):
            way = np.stack([start, *planned])
            if not self._blocked(way[:-1], way[1:], NEAR).any():
                return planned
        for margin in (CLEAR, NEAR):
            if found := self._around(start, goal, margin):
                return found
        way = np.stack([start, *via, goal])  # as planned: the wire will tell
        return [] if self.geometry.blocked(way[:-1], way[1:]).any() else [*via, goal]

    def _blocked(
        self,
        start: Float[np.ndarray, "ways joints"],
        end: Float[np.ndarray, "ways joints"],
        margin: float,
        step: float = STEP,
    ) -> Bool[np.ndarray, " ways"]:
        return self.geometry.blocked(start, end, margin, self.theta, step)

    def _around(self, start: Joints, goal: Joints, margin: float) -> list[Joints]:
        """The shortest way over approach points, those along the plan preferred."""
        from scipy.sparse.csgraph import csgraph_from_dense, dijkstra

        q = np.stack([start, *self._stops, goal])
        tip = self.geometry.tip(q)
        a, b = np.triu_indices(len(q), 1)
        cost = np.linalg.norm(tip[a] - tip[b], axis=1) + np.where((b == a + 1) & (a > 0), 0.0, UNPLANNED)
        dense = np.full((len(q), len(q)), np.inf)
        dense[a, b] = np.where(self._blocked(q[a], q[b], margin, np.inf), np.inf, cost)
        while True:  # a coarse look lets some ways pass that a closer one does not
            graph = csgraph_from_dense(dense, null_value=np.inf)
            distance, before = dijkstra(graph, directed=False, indices=np.array([0]), return_predecessors=True)
            if not np.isfinite(distance[0, -1]):
                return []
            way = [len(q) - 1]
            while way[0] != 0:
                way.insert(0, int(before[0, way[0]]))
            legs = np.array(list(pairwise(way)))
            blocked = legs[self._blocked(q[legs[:, 0]], q[legs[:, 1]], margin)]
            if not len(blocked):
                return [q[i] for i in way[1:]]
            dense[blocked.min(axis=1), blocked.max(axis=1)] = np.inf
