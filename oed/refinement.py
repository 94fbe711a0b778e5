"""Move chosen touches continuously over their faces, postures and rolls, with Ipopt, one touch after the other.

A touch moved alone changes the information by a rank-one update, so what it adds is a ratio of two quadratic forms of
its row f: log det grows by log(1 + f'Cf), tr(B C) falls by f'CBCf / (1 + f'Cf), with C the covariance of all others.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

from identify.model.inverse import reach
from identify.model.kinematics import AXIS, ONE, POINT, ZERO, jig_T_tip, symbols
from oed.candidates import COLUMNS, Candidates
from oed.information import Knowledge, touch_sigma
from oed.judgement import Judge, Verdict

SHARES = np.array([1.0, 0.6, 0.3, 0.1])  # of a move, tried in turn where the whole of it cannot be made
FAR = 0.6  # [rad], most that a joint turns in one move; times LEVER mm where it slides
LEVER = 300.0  # [mm]
APART = 5.0, np.radians(3.0)  # [mm] and [rad]: touches nearer than both would be the same touch again
ENOUGH = 1e-4  # of the criterion's logarithm that a sweep has to gain for another to follow
OPTIONS: dict[str, Any] = {
    "print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": 40, "ipopt.tol": 1e-5,
    "ipopt.acceptable_tol": 1e-3, "ipopt.acceptable_iter": 3, "ipopt.mu_init": 1e-3, "ipopt.bound_push": 1e-4,
    "ipopt.bound_frac": 1e-4,
}  # fmt: skip

Value = Callable[[Float[np.ndarray, "touches kept"]], float]  # of a set of rows; the larger the better
Aim = Callable[[Float[np.ndarray, "kept kept"]], Float[np.ndarray, "kept kept"]]  # W of a covariance C of the others


@dataclass(frozen=True, eq=False)
class Refinement:
    """The nonlinear program of one touch: the posture on a face that adds most to what all others tell."""

    known: Knowledge
    judge: Judge

    @cached_property
    def solver(self) -> ca.Function:
        """Ipopt on max f'Wf / (1 + f'Cf) over q, exact second derivatives, compiled once for all touches and faces."""
        robot, wire, k = self.known.cell.robot, self.known.cell.wire, len(self.known.names)
        q, theta = symbols(robot)
        n, origin, u, v, sigma = (ca.SX.sym(name, size) for name, size in zip("nouvs", (3, 3, 3, 3, 1), strict=True))
        C, W = ca.SX.sym("C", k, k), ca.SX.sym("W", k, k)
        tip, axis = (jig_T_tip(robot, q, theta, M, w) for M, w in ((POINT, ONE), (AXIS, ZERO)))
        lean = ca.dot(n, axis)
        height = ca.dot(n, tip - origin) - (wire.radius if wire.shape == "ball" else 0.0)
        if wire.shape == "flat":
            height -= wire.radius * ca.sqrt(ca.fmax(1 - lean**2, 1e-12))  # as in the model of a touch
        f = ca.gradient(height, theta)[self.known.kept] * self.known.scale / sigma
        place = [ca.dot(tip - origin, side) / ca.dot(side, side) for side in (u, v)]
        f, g = ca.substitute([f, ca.vertcat(height, *place, -lean)], [theta], [ca.SX(self.known.theta)])
        gain = ca.dot(f, W @ f) / (1 + ca.dot(f, C @ f))
        p = ca.vertcat(n, origin, u, v, sigma, ca.vec(C), ca.vec(W))
        return ca.nlpsol("refine", "ipopt", {"x": q, "p": p, "f": -gain, "g": g}, OPTIONS)

    def best(self, touch: Candidates, sigma: float, C: np.ndarray, W: np.ndarray) -> Float[np.ndarray, " joints"]:
        """Where Ipopt would have a touch, within joint limits, tilt and the inset of its face."""
        cell, i = self.known.cell, int(touch.face[0])
        face, robot = touch.faces[i], cell.robot
        inset = self.judge.margins.inset[i] / face.size
        far = FAR * np.where(robot.prismatic, LEVER, 1.0)
        solution = self.solver(
            x0=touch.q[0],
            p=np.concatenate([face.normal, face.origin, face.u, face.v, [sigma], C.ravel(), W.ravel() / _size(W)]),
            lbx=np.maximum(robot.lower, touch.q[0] - far), ubx=np.minimum(robot.upper, touch.q[0] + far),
            lbg=[0.0, *inset, np.cos(cell.touch.max_tilt)], ubg=[0.0, *(1 - inset), 1.0],
        )  # fmt: skip
        return np.array(solution["x"]).ravel()

    def ways(self, touch: Candidates, q: Float[np.ndarray, " joints"]) -> Candidates:
        """Touches on the way from one to a posture, the farthest first, all of which can be made."""
        made = self._landed(int(touch.face[0]), touch.q[0] + SHARES[:, None] * (q - touch.q[0]))
        if not len(made):
            return touch.take(np.arange(0))
        face = np.repeat(touch.face, len(made))
        approach, verdict = self.judge.touch(face, made)
        trial = self._touches(touch, made, approach)
        return trial.take((verdict == Verdict.FINE) & self._inset(trial))

    def _landed(self, face: int, q: Float[np.ndarray, "trials joints"]) -> Float[np.ndarray, "landed joints"]:
        """Postures brought into contact along the normal, the wire's direction and its turn kept."""
        cell = self.known.cell
        assert cell.jig is not None
        p, R = cell.kinematics.tip(q, self.known.theta)
        to = self._foot(face, p) + self._extent(face, R)[:, None] * cell.jig.faces[face].normal
        found = reach(
            cell.kinematics, self.known.theta, to, R, q, free_roll=q.shape[1] == 5, free_orientation=q.shape[1] < 5
        )
        return found.q[found.reached()]

    def _touches(self, touch: Candidates, q: np.ndarray, approach: np.ndarray) -> Candidates:
        """The same touch in other postures."""
        face = int(touch.face[0])
        p, R = self.known.cell.kinematics.tip(q, self.known.theta)
        lean = -(R[:, :, 2] @ touch.normal[0])
        normal = np.repeat(touch.normal, len(q), axis=0)
        return replace(
            touch, face=np.repeat(touch.face, len(q)), point=self._foot(face, p), normal=normal,
            tilt=np.arccos(np.clip(lean, -1, 1)), q=q, approach=approach,
        )  # fmt: skip

    def _foot(self, face: int, p: Float[np.ndarray, "trials 3"]) -> Float[np.ndarray, "trials 3"]:
        """Points dropped on the plane of a face."""
        assert self.known.cell.jig is not None
        plane = self.known.cell.jig.faces[face]
        return p - (p @ plane.normal - plane.offset)[:, None] * plane.normal

    def _extent(self, face: int, R: Float[np.ndarray, "trials 3 3"]) -> Float[np.ndarray, " trials"]:
        """How far the middle of the wire's end stays off its face [mm]."""
        wire, jig = self.known.cell.wire, self.known.cell.jig
        assert jig is not None
        if wire.shape == "flat":
            return wire.radius * np.sqrt(np.maximum(1 - (R[:, :, 2] @ jig.faces[face].normal) ** 2, 0.0))
        return np.full(len(R), wire.radius if wire.shape == "ball" else 0.0)

    def _inset(self, trial: Candidates) -> Bool[np.ndarray, " trials"]:
        """Whether contact points keep the inset from the edges of their face."""
        if not len(trial):
            return np.zeros(0, dtype=bool)
        face = trial.faces[int(trial.face[0])]
        inset = self.judge.margins.inset[trial.face[0]] / face.size - 1e-9
        at = face.fractions(trial.point)
        return np.asarray(((at >= inset) & (at <= 1 - inset)).all(axis=1))


def refine(
    refinement: Refinement,
    touches: Candidates,
    value: Value,
    aim: Aim,
    *,
    sweeps: int = 3,
    progress: Callable[[float], None] | None = None,
) -> Candidates:
    """Move touches one after the other, again and again, to where `value` of all rows is larger; never worse.

    `aim` makes W of the covariance of the others; a move counts only where it raises `value`, touches can be made, and
    no two become one.
    """
    known = refinement.known
    sigma = touch_sigma(known.cell, touches.names())
    F = known.rows(touches.q, touches.normal, sigma)
    best = value(F)
    for sweep in range(sweeps):
        before = best
        for i in range(len(touches)):
            C = np.linalg.inv(known.precision + F.T @ F - np.outer(F[i], F[i]))
            one = touches.take(np.array([i]))
            trial = refinement.ways(one, refinement.best(one, float(sigma[i]), C, aim(C)))
            rows = known.rows(trial.q, trial.normal, np.full(len(trial), sigma[i]))
            for k in np.flatnonzero(_apart(touches, i, trial)):
                moved = F.copy()
                moved[i] = rows[k]
                if (now := value(moved)) > best:
                    best, F = now, moved
                    touches = _put(touches, i, trial.take(np.array([k])))
                    break
            if progress:
                progress((sweep + (i + 1) / len(touches)) / sweeps)
        if best - before < ENOUGH * abs(best):
            break
    return touches


def _apart(touches: Candidates, i: int, trial: Candidates) -> Bool[np.ndarray, " trials"]:
    """Trials that are no replicate of another touch than the one that they come from."""
    others = touches.take(np.arange(len(touches)) != i)
    near = np.linalg.norm(others.point - trial.point[:, None], axis=2) < APART[0]
    turned = np.abs(others.q - trial.q[:, None]).max(axis=2) < APART[1]
    return ~(near & turned).any(axis=1)


def _put(touches: Candidates, i: int, one: Candidates) -> Candidates:
    """Touches with one of them replaced."""
    columns = {name: getattr(touches, name).copy() for name in COLUMNS}
    for name, column in columns.items():
        column[i] = getattr(one, name)[0]
    return replace(touches, **columns)


def _size(W: np.ndarray) -> float:
    """What brings W to the size of one, so that tolerances of the solver mean the same for every criterion."""
    return float(max(np.abs(W).max(), 1e-300))
