"""All touches moved at once: one nonlinear program with the Hessian in closed form.

The logarithm of tr(W M^-1) is minimised, with W = M0 S M0 at the information M0 that is moved from: the trace that
touches a criterion of slope S. With rows f_i, Jacobians J_i of them by the joints, C = M^-1 and U = C W C, the
derivatives of tr(W C) by the joints of touches i and j:

    gradient  -2 J_i'U f_i
    Hessian    2 [(f_i'U f_j) J_i'C J_j + (J_i'C f_j)(J_j'U f_i)' + the same with C and U exchanged]
               - 2 [i = j] (J_i'U J_i + sum_k (U f_i)_k Hess f_ik)
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from jaxtyping import Float

from oed.candidates.candidates import Candidates
from oed.refinement.nlp import OPTIONS, Program

ITERATIONS = 60


@dataclass(frozen=True, eq=False)
class Simultaneous:
    """The nonlinear program of n touches."""

    program: Program
    W: Float[np.ndarray, "kept kept"]
    n: int

    def best(self, touches: Candidates) -> Float[np.ndarray, "touches joints"]:
        """Where Ipopt would have all touches, within joint limits, tilt and insets."""
        at = self.program.numbers(touches)
        solution = self.solver(
            x0=at.x.ravel(),
            p=at.p.ravel(),
            lbx=at.x_limits[0].ravel(),
            ubx=at.x_limits[1].ravel(),
            lbg=at.g_limits[0].ravel(),
            ubg=at.g_limits[1].ravel(),
        )
        return np.array(solution["x"]).reshape(self.n, -1)[:, : touches.q.shape[1]]

    @cached_property
    def solver(self) -> ca.Function:
        """Ipopt with gradient and Hessian handed over."""
        x, p = self.symbols
        problem = {"x": x, "p": p, "f": self._value[0], "g": ca.vec(self.rows[2])}
        options = {"grad_f": self.gradient, "hess_lag": self.hessian, "ipopt.max_iter": ITERATIONS}
        return ca.nlpsol("simultaneous", "ipopt", problem, OPTIONS | options)

    @cached_property
    def gradient(self) -> ca.Function:
        """nlp_grad_f:(x,p)->(f,grad_f_x)."""
        x, p = self.symbols
        value, slope, _ = self._value
        still = ca.MX.zeros(*slope.shape)
        return ca.Function(
            "nlp_grad_f", [x, p], [value, ca.vec(ca.vertcat(slope, still))], ["x", "p"], ["f", "grad_f_x"]
        )

    @cached_property
    def hessian(self) -> ca.Function:
        """nlp_hess_l:(x,p,lam_f,lam_g)->(triu_hess_gamma_x_x)."""
        x, p = self.symbols
        program, half = self.program, self.program.x.shape[0] // 2
        w, lam = ca.SX.sym("w", program.row.shape[0]), ca.SX.sym("lam", program.constraints.shape[0])
        own = ca.hessian(ca.dot(w, program.row) + ca.dot(lam, program.constraints), program.x)[0]
        bent = ca.Function("bent", [program.x, program.p, w, lam], [own]).map(self.n)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", lam.shape[0] * self.n)
        _, _, weights = self._value
        curved = bent(self._columns(x), self._columns(p), lam_f * weights, ca.reshape(lam_g, lam.shape[0], self.n))
        size = program.x.shape[0]
        blocks = ca.diagcat(*[curved[:, size * i : size * (i + 1)] for i in range(self.n)])
        contact = ca.kron(ca.DM.eye(self.n), ca.sparsify(ca.vertcat(ca.DM.eye(half), ca.DM.zeros(half, half))))
        H = lam_f * (contact @ self._coupling @ contact.T) + blocks
        names = ["x", "p", "lam_f", "lam_g"]
        return ca.Function("nlp_hess_l", [x, p, lam_f, lam_g], [ca.triu(H)], names, ["triu_hess_gamma_x_x"])

    @cached_property
    def symbols(self) -> tuple[ca.MX, ca.MX]:
        """Unknowns and constants of all touches, one after the other."""
        return ca.MX.sym("x", self.program.x.shape[0] * self.n), ca.MX.sym("p", self.program.p.shape[0] * self.n)

    def _columns(self, flat: ca.MX) -> ca.MX:
        return ca.reshape(flat, flat.shape[0] // self.n, self.n)

    @cached_property
    def rows(self) -> tuple[ca.MX, ca.MX, ca.MX]:
        """Rows (kept x n), their Jacobians side by side (kept x joints n), constraints."""
        program, x, p = self.program, *self.symbols
        half = program.x.shape[0] // 2
        J = ca.jacobian(program.row, program.x)[:, :half]
        function = ca.Function("touch", [program.x, program.p], [program.row, J, program.constraints])
        f, jacobians, constraints = function.map(self.n)(self._columns(x), self._columns(p))
        return f, jacobians, constraints

    @cached_property
    def _inner(self) -> tuple[ca.MX, ca.MX]:
        """C and U."""
        M = ca.DM(self.program.coordinates.precision) + self.rows[0] @ self.rows[0].T
        C = ca.solve(M, ca.DM.eye(self.program.row.shape[0]))
        return C, C @ ca.DM(self.W) @ C

    @cached_property
    def _trace(self) -> ca.MX:
        return ca.trace(ca.DM(self.W) @ self._inner[0])

    @cached_property
    def _value(self) -> tuple[ca.MX, ca.MX, ca.MX]:
        """What is minimised, its slope by the joints of each touch, and by its row."""
        f, J, _ = self.rows
        weights = -2 * self._inner[1] @ f / self._trace
        joints = J.shape[1] // self.n
        slope = ca.reshape(ca.sum1(J * ca.kron(weights, ca.DM.ones(1, joints))), joints, self.n)
        return ca.log(self._trace), slope, weights

    @cached_property
    def _coupling(self) -> ca.MX:
        """The Hessian by the joints of all touches, without what bends in their rows."""
        f, J, _ = self.rows
        C, U = self._inner
        joints = J.shape[1] // self.n
        one, ones = ca.DM.ones(joints, joints), ca.DM.ones(1, joints)
        JC, JU = ca.kron(J.T @ C @ f, ones), ca.kron(J.T @ U @ f, ones)  # a column for each joint of touch j
        bilinear = (J.T @ C @ J) * ca.kron(f.T @ U @ f, one) + JC * JU.T
        bilinear += (J.T @ U @ J) * ca.kron(f.T @ C @ f, one) + JU * JC.T
        own = (J.T @ U @ J) * ca.kron(ca.DM.eye(self.n), one)
        slope = ca.vec(self._value[1])
        return 2 * (bilinear - own) / self._trace - slope @ slope.T
