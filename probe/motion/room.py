"""The one room that judges motions: what a plan, a run, a dry run and a resume may do with the robot that is known."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.jig import Face
from probe.motion.clearance import CLEAR, NEAR, Clearance
from probe.motion.edges import ROBOTS, Edges
from probe.motion.joint_path import Joints
from probe.motion.obstacles import owners
from probe.motion.roadmap import Roadmap
from probe.motion.tour import between

SIGMAS = 2.0  # of the tip's deviation that a way keeps from the jig
PLACES = 8  # postures at which that deviation is taken
UNKNOWN = 1e3  # [mm] or [rad], variance of what is to be fitted
LOOKS = 9  # on a search, between approach and contact
TINY = 1e-16  # [mm2] or [rad2], added to variances so that they have a root
TYPICAL = 90  # percentile of the deviation over these postures


class Room:
    """Ways and searches of a robot as it is known now; `stops` are postures that ways may pass."""

    def __init__(self, cell: Cell, stops: Sequence[Joints]) -> None:
        self.cell = cell
        self._stops = np.stack(stops)
        spread = np.where(np.isfinite(cell.prior), cell.spread, UNKNOWN)
        self.believe(cell.theta, np.diag(spread**2))

    def believe(
        self, theta: Float[np.ndarray, " parameters"], covariance: Float[np.ndarray, "parameters parameters"]
    ) -> None:
        """From now on judge a robot of these parameters, as uncertain as their covariance says."""
        self.theta, self._covariance = theta, covariance
        self.__dict__.pop("roadmap", None)

    @cached_property
    def roadmap(self) -> Roadmap:
        """The ways of the robot that is known now."""
        some = self._stops[:: max(1, len(self._stops) // PLACES)]
        _, J = self.cell.kinematics.tip_jacobian(some, self.theta)
        worst = np.linalg.eigvalsh(J @ self._covariance @ J.transpose(0, 2, 1))[:, -1]
        keep = SIGMAS * float(np.sqrt(max(np.percentile(worst, TYPICAL), 0.0)))
        return Roadmap(self._nominal.at(self.theta, keep, self._robots()), self._stops)

    def _robots(self) -> Float[np.ndarray, "robots parameters"]:
        """Robots that may be the real one, as far as anything is known of it."""
        known = np.diag(self._covariance) < UNKNOWN**2
        L = np.linalg.cholesky(self._covariance[np.ix_(known, known)] + TINY * np.eye(known.sum()))
        robots = np.tile(self.theta, (ROBOTS, 1))
        robots[:, known] += np.random.default_rng(0).standard_normal((ROBOTS, known.sum())) @ L.T
        return robots

    @cached_property
    def _nominal(self) -> Edges:
        return Edges(Clearance(self.cell, self.cell.theta))

    @property
    def clearance(self) -> Clearance:
        """Arm and torch among the obstacles, by the parameters that are known now."""
        return self.roadmap.edges.clearance

    def route(self, start: Joints, goal: Joints, via: Sequence[Joints] = ()) -> list[Joints]:
        """Postures to go to one after the other, as planned, straight or around; empty where no clear way was found."""
        return self.roadmap.route(start, goal, via)

    def clear(self, legs: Sequence[Float[np.ndarray, "postures joints"]]) -> list[bool]:
        """Whether paths over some postures are clear, each leg by the least that is safe."""
        edges = replace(self.roadmap.edges, keep=0.0, risk=1.0)
        ok = edges.clear(np.concatenate([leg[:-1] for leg in legs]), np.concatenate([leg[1:] for leg in legs]))
        path = np.repeat(np.arange(len(legs)), [len(leg) - 1 for leg in legs])
        return (np.bincount(path, ~ok, len(legs)) == 0).tolist()

    def met(self, q: Float[np.ndarray, "postures joints"]) -> list[str]:
        """What arm, torch or wire meet in postures, and where; one sentence for each posture in which they do."""
        hit = self.clearance.hits(q, margin=0.0)
        out = [encounter(self.clearance, q[i], int(hit[i])) for i in np.flatnonzero(hit != CLEAR)]
        inside = np.flatnonzero((hit == CLEAR) & (self.clearance.segment_gaps(*self.clearance.wire(q)) <= 0))
        return out + [self._wire(q[[i]]) for i in inside]

    def hits(
        self,
        face: Sequence[Face],
        approach: Float[np.ndarray, "touches joints"],
        contact: Float[np.ndarray, "touches joints"],
    ) -> list[str]:
        """For each touch, what arm or torch hit between approach and contact and where; empty where nothing is hit.

        The search ends at its face: postures that the model has behind it are never reached.
        """
        q = between(approach, contact, LOOKS)
        own = np.repeat(self._own(face), LOOKS, axis=0)
        hit = self.clearance.hits(q.reshape(-1, q.shape[2]), own, NEAR, NEAR).reshape(len(face), LOOKS)
        tip = self.cell.kinematics.tip(q.reshape(-1, q.shape[2]), self.theta)[0].reshape(len(face), LOOKS, 3)
        out = []
        for i, one in enumerate(face):
            met = np.flatnonzero((hit[i] != CLEAR) & (tip[i] @ one.normal > one.offset))
            out.append(encounter(self.clearance, q[i, met[0]], int(hit[i, met[0]])) if len(met) else "")
        return out

    def _own(self, face: Sequence[Face]) -> Bool[np.ndarray, "touches obstacles"]:
        """Obstacles that touches on faces come near of necessity."""
        assert self.cell.jig is not None
        number: Int[np.ndarray, " touches"] = np.array([self._face_number[one.name] for one in face], dtype=int)
        return np.asarray(self._owners[number])

    @cached_property
    def _owners(self) -> Bool[np.ndarray, "faces obstacles"]:
        assert self.cell.jig is not None
        return owners(self.cell.jig, self._nominal.clearance.solids)

    @cached_property
    def _face_number(self) -> dict[str, int]:
        assert self.cell.jig is not None
        return {face.name: i for i, face in enumerate(self.cell.jig.faces)}

    def obstruction(self, start: Joints, goal: Joints, via: Sequence[Joints] = ()) -> str:
        """What is hit first on the way over some postures, and where; the wire, where arm and torch hit nothing."""
        way = np.stack([start, *via, goal])
        q = between(way[:-1], way[1:], 33).reshape(-1, way.shape[1])
        hit = self.clearance.hits(q, margin=0.0)
        first = int(np.argmax(hit != CLEAR))
        if hit[first] != CLEAR:
            return encounter(self.clearance, q[first], int(hit[first]))
        return self._wire(q)

    def _wire(self, q: Float[np.ndarray, "postures joints"]) -> str:
        """What the wire comes nearest to in some postures, and where."""
        tip, back = self.clearance.wire(q)
        near = int(np.argmin(self.clearance.segment_gaps(tip, back)))
        solid = min(self.clearance.solids, key=lambda s: float(s.segment(tip[:, [near]], back[:, [near]])[0]))
        return f"the wire and {solid.name} meet near {_place(tip[:, near])}"


def encounter(clearance: Clearance, q: Joints, hit: int) -> str:
    """Which two bodies meet in a posture that hits an obstacle, or the arm itself, and where, in words."""
    start, end = (x[:, :, 0].T for x in clearance.ends(q[None]))
    along = start[:, None] + np.linspace(0, 1, 65)[:, None] * (end - start)[:, None]  # capsules, points, 3
    if hit < len(clearance.solids):
        solid = clearance.solids[hit]
        gap = np.stack([solid.point(p.T) for p in along]) - clearance.radius[:, None]
        gap[[c.link == 0 for c in clearance.capsules]] = np.inf
        one, point = np.unravel_index(int(np.argmin(gap)), gap.shape)
        return f"{_body(clearance, int(one))} and {solid.name} meet near {_place(along[one, point])}"
    away = np.array([np.linalg.norm(along[i][:, None] - along[j], axis=2).min() for i, j in clearance.pairs])
    i, j = clearance.pairs[int(np.argmin(away - [clearance.radius[[i, j]].sum() for i, j in clearance.pairs]))]
    k = int(np.linalg.norm(along[i][:, None] - along[j], axis=2).min(axis=1).argmin())
    return f"{_body(clearance, i)} and {_body(clearance, j)} meet near {_place(along[i, k])}"


def _body(clearance: Clearance, i: int) -> str:
    """What a capsule stands for."""
    if i < len(clearance.bodies):
        return f"link '{clearance.bodies[i].shape.name}'"
    link = clearance.capsules[i].link
    return "the torch" if link == len(clearance.cell.robot.joints) else f"link {link}"


def _place(p: Float[np.ndarray, " 3"]) -> str:
    x, y, z = p.tolist()
    return f"({x:.0f}, {y:.0f}, {z:.0f}) mm"
