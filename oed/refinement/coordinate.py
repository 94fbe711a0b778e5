"""Move chosen touches continuously over their faces, postures and rolls, with Ipopt, one by one and then all at once.

With C the covariance of all other touches and S the slope of the criterion there, a touch with row f raises det M by
the factor 1 + f'Cf, and lowers a trace by a share f'Sf / (1 + f'Cf), which for the determinant grows with the same
f'Cf. Any other criterion is touched by such a trace: so one program moves a touch for every criterion.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.ik import reach
from identify.uncertainty.coordinates import Coordinates
from oed.candidates.candidates import COLUMNS, Candidates
from oed.candidates.feasibility import Feasibility, Infeasibility
from oed.criteria.criterion import Criterion
from oed.refinement.nlp import OPTIONS, Program

SHARES = np.array([1.0, 0.6, 0.3, 0.1])  # of a move, tried in turn where the whole of it cannot be made
APART = 5.0, np.radians(3.0)  # [mm] and [rad]: touches nearer than both would be the same touch again
ENOUGH = 2e-3  # of the criterion's logarithm that a sweep has to gain for another to follow


@dataclass(frozen=True, eq=False)
class Refinement:
    """The nonlinear program of one touch: the posture on a face that adds most to what all others tell."""

    coordinates: Coordinates
    feasibility: Feasibility

    @property
    def cell(self) -> Cell:
        """The cell to be touched."""
        return self.coordinates.prior.unknowns.cell

    @cached_property
    def program(self) -> Program:
        """The touch in symbols."""
        return Program(self.coordinates, self.feasibility.margins)

    @cached_property
    def solver(self) -> ca.Function:
        """Ipopt on max f'Sf / (1 + f'Cf), compiled once for all touches and faces.

        With a = f'Sf, b = 1 + f'Cf, J the Jacobian of f and w the gradient of the gain by f, the Hessian is
        J' [2 S / b - 4 (S f f'C + C f f'S) / b^2 - 2 a C / b^2 + 8 a C f f'C / b^3] J + sum_k w_k Hess f_k.
        """
        program, k = self.program, len(self.coordinates)
        x, p = ca.MX.sym("x", *program.x.shape), ca.MX.sym("p", *program.p.shape)
        C, S = ca.MX.sym("C", k, k), ca.MX.sym("S", k, k)
        f, J = program.touch(x, p)
        g, slopes = program.limits(x, p)
        a, b = ca.dot(f, S @ f), 1 + ca.dot(f, C @ f)
        Sf, Cf = S @ f, C @ f
        w = 2 * Sf / b - 2 * a * Cf / b**2
        bend = 2 * S / b - 4 * (Sf @ Cf.T + Cf @ Sf.T) / b**2 - 2 * a * C / b**2 + 8 * a * Cf @ Cf.T / b**3
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", *g.shape)
        constants = ca.vertcat(p, ca.vec(C), ca.vec(S))
        H = program.bent(x, p, -lam_f * w, lam_g) - lam_f * (J.T @ bend @ J)
        arguments = [x, constants, lam_f, lam_g]
        names = ["x", "p", "lam_f", "lam_g"]
        hessian = ca.Function("nlp_hess_l", arguments, [ca.triu(H)], names, ["triu_hess_gamma_x_x"])
        slope = ca.Function("nlp_grad_f", arguments[:2], [-a / b, ca.densify(-J.T @ w)], names[:2], ["f", "grad_f_x"])
        limits = ca.Function("nlp_jac_g", arguments[:2], [g, slopes], names[:2], ["g", "jac_g_x"])
        f, g = program.values(x, p)  # a Jacobian at each step of a line search would take most of the time
        problem = {"x": x, "p": constants, "f": -ca.dot(f, S @ f) / (1 + ca.dot(f, C @ f)), "g": g}
        return ca.nlpsol("refine", "ipopt", problem, OPTIONS | {"grad_f": slope, "jac_g": limits, "hess_lag": hessian})

    def best(
        self,
        touches: Candidates,
        C: Float[np.ndarray, "touches kept kept"],
        S: Float[np.ndarray, "touches kept kept"],
        progress: Callable[[float], None] | None = None,
    ) -> Float[np.ndarray, "touches joints"]:
        """Where Ipopt would have touches, each alone, within joint limits, tilt and the inset of its face.

        C is the covariance of all others, or zero to find the largest f'Sf.
        """
        at, out = self.program.numbers(touches), touches.q.copy()
        for i in range(len(touches)):
            solution = self.solver(
                x0=at.x[i],
                p=np.concatenate([at.p[i], C[i].ravel(), (S[i] / _size(S[i])).ravel()]),
                lbx=at.x_limits[0, i],
                ubx=at.x_limits[1, i],
                lbg=at.g_limits[0, i],
                ubg=at.g_limits[1, i],
            )
            out[i] = np.array(solution["x"]).ravel()[: out.shape[1]]
            if progress:
                progress((i + 1) / len(touches))
        return out

    def approaches(
        self, touches: Candidates, q: Float[np.ndarray, "touches joints"]
    ) -> tuple[Candidates, Int[np.ndarray, " trials"]]:
        """Touches on the way from each one to a posture, the farthest first, that can be made; and from which one."""
        owner = np.repeat(np.arange(len(touches)), len(SHARES))
        looks = (touches.q[:, None] + SHARES[:, None] * (q - touches.q)[:, None]).reshape(len(owner), -1)
        face = touches.face[owner]
        q, landed = self._landed(face, looks)
        approach, infeasibility = self.feasibility.touch(face, q)
        p, R = self.cell.kinematics.tip(q, self.coordinates.theta)
        normal = touches.normal[owner]
        lean = -(R[:, :, 2] * normal).sum(axis=1)
        trials = replace(
            touches,
            face=face,
            point=self._foot(face, p),
            normal=normal,
            tilt=np.arccos(np.clip(lean, -1, 1)),
            q=q,
            approach=approach,
            hit=touches.hit[owner],
        )
        fine = landed & (infeasibility == Infeasibility.NONE) & self._inset(trials)
        trials, owner = trials.take(fine), owner[fine]
        hit = trials.hits.share(trials.face, trials.q)
        sure = trials.hits.sure(trials.face, hit)
        return replace(trials, hit=hit).take(sure), owner[sure]

    def _landed(
        self, face: Int[np.ndarray, " trials"], q: Float[np.ndarray, "trials joints"]
    ) -> tuple[Float[np.ndarray, "trials joints"], Bool[np.ndarray, " trials"]]:
        """Postures brought into contact along the normal, the wire's direction and its turn kept; and which were."""
        p, R = self.cell.kinematics.tip(q, self.coordinates.theta)
        normal = self._normal[face]
        to = self._foot(face, p) + self._extent(face, R)[:, None] * normal
        result = reach(
            self.cell.kinematics,
            self.coordinates.theta,
            to,
            R,
            q,
            free_roll=q.shape[1] == 5,
            free_orientation=q.shape[1] < 5,
        )
        return result.q, result.reached()

    @cached_property
    def _normal(self) -> Float[np.ndarray, "faces 3"]:
        return np.stack([face.normal for face in self.cell.the_jig.faces])

    @cached_property
    def _offset(self) -> Float[np.ndarray, " faces"]:
        return np.array([face.offset for face in self.cell.the_jig.faces])

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
        wire = self.cell.wire
        lean = (R[:, :, 2] * self._normal[face]).sum(axis=1)
        return np.asarray(wire.ball + wire.flat * np.sqrt(np.maximum(1 - lean**2, 0.0)))

    def _inset(self, trials: Candidates) -> Bool[np.ndarray, " trials"]:
        """Whether contact points keep the inset from the edges of their faces."""
        ok = np.ones(len(trials), dtype=bool)
        for i in np.unique(trials.face):
            mine, face = trials.face == i, trials.faces[i]
            inset, at = self.feasibility.margins.inset[i] / face.size - 1e-9, face.fractions(trials.point[mine])
            ok[mine] = ((at >= inset) & (at <= 1 - inset)).all(axis=1)
        return ok


def refine(
    refinement: Refinement,
    touches: Candidates,
    criterion: Criterion,
    *,
    sweeps: int = 3,
    progress: Callable[[float], None] | None = None,
) -> Candidates:
    """Move touches, again and again, to where they tell more by the criterion; never worse.

    A move counts only where it raises the criterion of all touches, together with all moves before it, where the touch
    can be made, and where no two touches become one.
    """
    coordinates, say = refinement.coordinates, progress or (lambda share: None)
    F = coordinates.rows(touches.expected_rows(refinement.cell))

    def value(rows: Float[np.ndarray, "touches kept"]) -> float:
        return criterion.log(coordinates.information(rows))

    for sweep in range(sweeps):
        before = value(F)
        others = coordinates.information(F) - F[:, :, None] * F[:, None, :]
        S = np.stack([criterion.slope(M) for M in others])
        goals = refinement.best(touches, np.linalg.inv(others), S, partial(_share, say, sweep, sweeps))
        touches, F = _accepted(refinement, touches, F, goals, value)
        if value(F) - before < ENOUGH:
            break
    return touches


def _share(say: Callable[[float], None], sweep: int, sweeps: int, share: float) -> None:
    say((sweep + share) / sweeps)


def _accepted(
    refinement: Refinement,
    touches: Candidates,
    F: Float[np.ndarray, "touches kept"],
    goals: Float[np.ndarray, "touches joints"],
    value: Callable[[Float[np.ndarray, "touches kept"]], float],
) -> tuple[Candidates, Float[np.ndarray, "touches kept"]]:
    """Touches after those moves towards `goals` that can be made and raise the value; and their rows."""
    trials, owner = refinement.approaches(touches, goals)
    rows = refinement.coordinates.rows(trials.expected_rows(refinement.cell))
    best, indices = value(F), set[int]()
    for k, i in enumerate(owner.tolist()):
        if i in indices or not _apart(touches, i, trials, k):
            continue
        changed = F.copy()
        changed[i] = rows[k]
        if (now := value(changed)) > best:
            best, F = now, changed
            touches = replaced(touches, np.array([i]), trials.take(np.array([k])))
            indices.add(i)
    return touches, F


def _apart(touches: Candidates, i: int, trials: Candidates, k: int) -> bool:
    """Whether a trial is no replicate of another touch than the one that it comes from."""
    near = np.linalg.norm(touches.point - trials.point[k], axis=1) < APART[0]
    turned = np.abs(touches.q - trials.q[k]).max(axis=1) < APART[1]
    return not (near & turned & (np.arange(len(touches)) != i)).any()


def replaced(touches: Candidates, index: Int[np.ndarray, " some"], others: Candidates) -> Candidates:
    """Touches with some of them replaced."""
    columns = {name: getattr(touches, name).copy() for name in COLUMNS}
    for name, column in columns.items():
        column[index] = getattr(others, name)
    return replace(touches, **columns)


def _size(S: np.ndarray) -> float:
    """What brings S to the size of one, so that tolerances of the solver mean the same for every criterion."""
    return float(max(np.abs(S).max(), 1e-300))
