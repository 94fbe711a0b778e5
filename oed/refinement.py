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
from jaxtyping import Bool, Float, Int

from identify.model.descent import LEVER
from identify.model.inverse import reach
from identify.model.kinematics import jig_T_tip, symbols
from oed.candidates import COLUMNS, Candidates
from oed.information import Knowledge, touch_sigma
from oed.judgement import Judge, Verdict

SHARES = np.array([1.0, 0.6, 0.3, 0.1])  # of a move, tried in turn where the whole of it cannot be made
FAR = 0.6  # [rad], most that a joint turns in one move; times LEVER mm where it slides
HAIR = 1e-6  # [rad] or [mm] that solutions keep from limits, for rounding
APART = 5.0, np.radians(3.0)  # [mm] and [rad]: touches nearer than both would be the same touch again
ENOUGH = 2e-3  # of the criterion's logarithm that a sweep has to gain for another to follow
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
        """Ipopt on max f'Wf / (1 + f'Cf), exact second derivatives, compiled once for all touches and faces.

        The unknowns are the postures at contact and at approach, so that joint limits hold from the approach to the end
        of the search.
        """
        robot, k = self.known.cell.robot, len(self.known.names)
        q, theta = symbols(robot)
        above = ca.SX.sym("above", q.shape[0])
        n, origin, u, v, sigma, room = (ca.SX.sym(s, m) for s, m in zip("nouvsr", (3, 3, 3, 3, 1, 1), strict=True))
        C, W = ca.SX.sym("C", k, k), ca.SX.sym("W", k, k)
        tip, R = self._pose(q, theta)
        lean = ca.dot(n, R[:, 2])
        height = self._height(ca.dot(n, tip - origin), lean)
        f = ca.gradient(height, theta)[self.known.kept] * self.known.scale / sigma
        place = [ca.dot(tip - origin, side) / ca.dot(side, side) for side in (u, v)]
        held = self._held(tip, R, *self._pose(above, theta), self.known.cell.touch.approach * n)
        g = ca.vertcat(height, *place, -lean, *held, above + room * (q - above))
        f, g = ca.substitute([f, g], [theta], [ca.SX(self.known.theta)])
        gain = ca.dot(f, W @ f) / (1 + ca.dot(f, C @ f))
        p = ca.vertcat(n, origin, u, v, sigma, room, ca.vec(C), ca.vec(W))
        return ca.nlpsol("refine", "ipopt", {"x": ca.vertcat(q, above), "p": p, "f": -gain, "g": g}, OPTIONS)

    def _pose(self, q: ca.SX, theta: ca.SX) -> tuple[ca.SX, ca.SX]:
        T = jig_T_tip(self.known.cell.robot, q, theta, ca.SX.eye(4)[:3, :], ca.SX([[0, 0, 0, 1]]))
        return T[:, 3], T[:, :3]

    def _height(self, height: ca.SX, lean: ca.SX) -> ca.SX:
        """Distance of the end of the wire from the face, as in the model of a touch."""
        wire = self.known.cell.wire
        if wire.shape == "flat":
            return height - wire.radius * ca.sqrt(ca.fmax(1 - lean**2, 1e-12))
        return height - (wire.radius if wire.shape == "ball" else 0.0)

    def _held(self, tip: ca.SX, R: ca.SX, high: ca.SX, turned: ca.SX, way: ca.SX) -> list[ca.SX]:
        """What is zero where the approach holds the same wire off the face: as much as the robot's joints can keep."""
        joints = len(self.known.cell.robot.joints)
        rest = (turned.T @ R - R.T @ turned) / 2
        turn = ca.vertcat(rest[2, 1], rest[0, 2], rest[1, 0])
        return [high - tip - way, turn if joints > 5 else turn[:2] if joints == 5 else ca.SX(0, 1)]

    def best(
        self, touch: Candidates, sigma: float, C: Float[np.ndarray, "kept kept"], W: Float[np.ndarray, "kept kept"]
    ) -> Float[np.ndarray, " joints"]:
        """Where Ipopt would have a touch, within joint limits, tilt and the inset of its face."""
        cell, i = self.known.cell, int(touch.face[0])
        face, robot = touch.faces[i], cell.robot
        inset = self.judge.margins.inset[i] / face.size
        room = 1 + self.judge.margins.overtravel[i] / cell.touch.approach
        far = FAR * np.where(robot.prismatic, LEVER, 1.0)
        lower, upper = robot.lower + HAIR, robot.upper - HAIR
        zeros = np.zeros(self.solver.size1_in("lbg") - 4 - len(lower))
        solution = self.solver(
            x0=np.concatenate([touch.q[0], touch.approach[0]]),
            p=np.concatenate(
                [face.normal, face.origin, face.u, face.v, [sigma, room], C.ravel(), (W / _size(W)).ravel()]
            ),
            lbx=np.concatenate([np.maximum(lower, touch.q[0] - far), lower]),
            ubx=np.concatenate([np.minimum(upper, touch.q[0] + far), upper]),
            lbg=np.concatenate([[0.0], inset, [np.cos(cell.touch.max_tilt - HAIR)], zeros, lower]),
            ubg=np.concatenate([[0.0], 1 - inset, [1.0], zeros, upper]),
        )  # fmt: skip
        return np.array(solution["x"]).ravel()[: len(lower)]

    def ways(
        self, touches: Candidates, q: Float[np.ndarray, "touches joints"]
    ) -> tuple[Candidates, Int[np.ndarray, " trials"]]:
        """Touches on the way from each one to a posture, the farthest first, that can be made; and from which one."""
        owner = np.repeat(np.arange(len(touches)), len(SHARES))
        asked = (touches.q[:, None] + SHARES[:, None] * (q - touches.q)[:, None]).reshape(len(owner), -1)
        face = touches.face[owner]
        q, landed = self._landed(face, asked)
        approach, verdict = self.judge.touch(face, q)
        p, R = self.known.cell.kinematics.tip(q, self.known.theta)
        normal = touches.normal[owner]
        lean = -(R[:, :, 2] * normal).sum(axis=1)
        trials = replace(
            touches, face=face, point=self._foot(face, p), normal=normal, tilt=np.arccos(np.clip(lean, -1, 1)), q=q,
            approach=approach,
        )  # fmt: skip
        fine = landed & (verdict == Verdict.FINE) & self._inset(trials)
        return trials.take(fine), owner[fine]

    def _landed(
        self, face: Int[np.ndarray, " trials"], q: Float[np.ndarray, "trials joints"]
    ) -> tuple[Float[np.ndarray, "trials joints"], Bool[np.ndarray, " trials"]]:
        """Postures brought into contact along the normal, the wire's direction and its turn kept; and which were."""
        p, R = self.known.cell.kinematics.tip(q, self.known.theta)
        normal = self._normal[face]
        to = self._foot(face, p) + self._extent(face, R)[:, None] * normal
        found = reach(
            self.known.cell.kinematics, self.known.theta, to, R, q, free_roll=q.shape[1] == 5,
            free_orientation=q.shape[1] < 5,
        )  # fmt: skip
        return found.q, found.reached()

    @cached_property
    def _normal(self) -> Float[np.ndarray, "faces 3"]:
        assert self.known.cell.jig is not None
        return np.stack([face.normal for face in self.known.cell.jig.faces])

    @cached_property
    def _offset(self) -> Float[np.ndarray, " faces"]:
        assert self.known.cell.jig is not None
        return np.array([face.offset for face in self.known.cell.jig.faces])

    def _foot(
        self, face: Int[np.ndarray, " trials"], p: Float[np.ndarray, "trials 3"]
    ) -> Float[np.ndarray, "trials 3"]:
        """Points dropped on the planes of faces."""
        normal = self._normal[face]
        return p - ((p * normal).sum(axis=1) - self._offset[face])[:, None] * normal

    def _extent(
        self, face: Int[np.ndarray, " trials"], R: Float[np.ndarray, "trials 3 3"]
    ) -> Float[np.ndarray, " trials"]:
        """How far the middle of the wire's end stays off its face [mm]."""
        wire = self.known.cell.wire
        if wire.shape == "flat":
            lean = (R[:, :, 2] * self._normal[face]).sum(axis=1)
            return wire.radius * np.sqrt(np.maximum(1 - lean**2, 0.0))
        return np.full(len(R), wire.radius if wire.shape == "ball" else 0.0)

    def _inset(self, trials: Candidates) -> Bool[np.ndarray, " trials"]:
        """Whether contact points keep the inset from the edges of their faces."""
        ok = np.ones(len(trials), dtype=bool)
        for i in np.unique(trials.face):
            mine, face = trials.face == i, trials.faces[i]
            inset, at = self.judge.margins.inset[i] / face.size - 1e-9, face.fractions(trials.point[mine])
            ok[mine] = ((at >= inset) & (at <= 1 - inset)).all(axis=1)
        return ok


def refine(
    refinement: Refinement,
    touches: Candidates,
    value: Value,
    aim: Aim,
    *,
    sweeps: int = 3,
    progress: Callable[[float], None] | None = None,
) -> Candidates:
    """Move touches, again and again, to where `value` of all rows is larger; never worse.

    `aim` makes W of the covariance C of the others. A move counts only where it raises `value`, together with all moves
    before it, where the touch can be made, and where no two touches become one.
    """
    known, n = refinement.known, len(touches)
    sigma = touch_sigma(known.cell, touches.names())
    F = known.rows(touches.q, touches.normal, sigma)
    best = value(F)
    for sweep in range(sweeps):
        before, wanted = best, touches.q.copy()
        M = known.precision + F.T @ F
        for i in range(n):
            C = np.linalg.inv(M - np.outer(F[i], F[i]))
            wanted[i] = refinement.best(touches.take(np.array([i])), float(sigma[i]), C, aim(C))
            if progress:
                progress((sweep + (i + 1) / n) / sweeps)
        trials, owner = refinement.ways(touches, wanted)
        rows = known.rows(trials.q, trials.normal, sigma[owner])
        moved: set[int] = set()
        for k, i in enumerate(owner.tolist()):
            if i in moved or not _apart(touches, i, trials, k):
                continue
            changed = F.copy()
            changed[i] = rows[k]
            if (now := value(changed)) > best:
                best, F = now, changed
                touches = _put(touches, i, trials, k)
                moved.add(i)
        if best - before < ENOUGH:
            break
    return touches


def _apart(touches: Candidates, i: int, trials: Candidates, k: int) -> bool:
    """Whether a trial is no replicate of another touch than the one that it comes from."""
    near = np.linalg.norm(touches.point - trials.point[k], axis=1) < APART[0]
    turned = np.abs(touches.q - trials.q[k]).max(axis=1) < APART[1]
    return not (near & turned & (np.arange(len(touches)) != i)).any()


def _put(touches: Candidates, i: int, trials: Candidates, k: int) -> Candidates:
    """Touches with one of them replaced."""
    columns = {name: getattr(touches, name).copy() for name in COLUMNS}
    for name, column in columns.items():
        column[i] = getattr(trials, name)[k]
    return replace(touches, **columns)


def _size(W: np.ndarray) -> float:
    """What brings W to the size of one, so that tolerances of the solver mean the same for every criterion."""
    return float(max(np.abs(W).max(), 1e-300))
