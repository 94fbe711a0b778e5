"""One touch as CasADi symbols: what its row is, and what its postures at contact and at approach have to keep."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.ik_step import LEVER
from identify.model.joint_error_models import FURTHER
from identify.model.kinematics import jig_T_tip, symbols
from identify.model.measurement import Rows
from identify.uncertainty.coordinates import Coordinates
from oed.candidates.candidates import Candidates
from oed.candidates.edge_margins import Margins

FAR = 0.6  # [rad], most that a joint turns in one move; times LEVER mm where it slides
OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 20,
    "ipopt.tol": 1e-3,
    "ipopt.acceptable_tol": 1e-2,
    "ipopt.acceptable_iter": 3,
    "ipopt.mu_init": 1e-3,
    "ipopt.bound_push": 1e-4,
    "ipopt.bound_frac": 1e-4,
}
HAIR = 1e-6  # [rad] or [mm] that solutions keep from limits, for rounding


@dataclass(frozen=True, eq=False)
class Numbers:
    """Where a touch starts from, its constants, and its limits: one row a touch."""

    x: Float[np.ndarray, "touches unknowns"]
    p: Float[np.ndarray, "touches constants"]
    x_limits: Float[np.ndarray, "2 touches unknowns"]
    g_limits: Float[np.ndarray, "2 touches constraints"]


@dataclass(frozen=True, eq=False)
class Program:
    """A touch as unknowns x and constants p.

    The unknowns are its postures at contact and at approach, so that joint limits hold from the approach to the end of
    the search; the constants are its face, its sigma, where its search ends, and the part of its row that faces make.
    """

    coordinates: Coordinates
    margins: Margins

    @property
    def cell(self) -> Cell:
        """The cell to be touched."""
        return self.coordinates.prior.unknowns.cell

    @cached_property
    def x(self) -> ca.SX:
        """Joints at contact, and at approach."""
        return ca.SX.sym("x", 2 * len(self.cell.robot.joints))

    @cached_property
    def p(self) -> ca.SX:
        """Normal, origin, u and v of the face, sigma, the end of the search in units of the approach, and the row of
        what touches share.
        """
        return ca.SX.sym("p", 14 + len(self.coordinates))

    @cached_property
    def _model(self) -> tuple[ca.SX, ca.SX]:
        """Row f and constraints g, in x and p."""
        joints = len(self.cell.robot.joints)
        _, theta = symbols(self.cell.robot)
        q, above = self.x[:joints], self.x[joints:]
        n, origin, u, v = (self.p[i : i + 3] for i in (0, 3, 6, 9))
        conditions = ca.vertcat(ca.sign(q - above), ca.SX.zeros(FURTHER))  # the side from which each joint comes
        tip, R = self._pose(q, theta, conditions)
        lean = ca.dot(n, R[:, 2])
        height = self._height(ca.dot(n, tip - origin), lean)
        unknowns = self.coordinates.prior.unknowns
        own = ca.gradient(height, theta)[unknowns.parameters.tolist()] * unknowns.scale[: len(unknowns.parameters)]
        basis = ca.sparsify(ca.DM(self.coordinates.basis[: len(unknowns.parameters)]))
        f = basis.T @ own / self.p[12] + self.p[14:]
        place = [ca.dot(tip - origin, side) / ca.dot(side, side) for side in (u, v)]
        straight = self._held(tip, R, *self._pose(above, theta), self.cell.touch.approach * n)
        g = ca.vertcat(height, *place, -lean, *straight, above + self.p[13] * (q - above))
        at = ca.SX(self.coordinates.theta)
        return ca.substitute(f, theta, at), ca.substitute(g, theta, at)

    @property
    def row(self) -> ca.SX:
        """What the touch tells, whitened, as its posture at contact makes it."""
        return self._model[0]

    @property
    def constraints(self) -> ca.SX:
        """Height over the face, place on it, lean, approach held off the face, and end of the search."""
        return self._model[1]

    @cached_property
    def values(self) -> ca.Function:
        """values:(x,p)->(f,g)."""
        return ca.Function("values", [self.x, self.p], [self.row, self.constraints])

    @cached_property
    def touch(self) -> ca.Function:
        """touch:(x,p)->(f,df/dx)."""
        return ca.Function("touch", [self.x, self.p], [self.row, ca.jacobian(self.row, self.x)])

    @cached_property
    def limits(self) -> ca.Function:
        """limits:(x,p)->(g,dg/dx)."""
        return ca.Function("limits", [self.x, self.p], [self.constraints, ca.jacobian(self.constraints, self.x)])

    @cached_property
    def bent(self) -> ca.Function:
        """bent:(x,p,w,lam)->(Hessian of w'f + lam'g)."""
        w, lam = ca.SX.sym("w", self.row.shape[0]), ca.SX.sym("lam", self.constraints.shape[0])
        own = ca.hessian(ca.dot(w, self.row) + ca.dot(lam, self.constraints), self.x)[0]
        return ca.Function("bent", [self.x, self.p, w, lam], [own])

    def numbers(self, touches: Candidates) -> Numbers:
        """Constants and limits of touches: inset, tilt, joint limits, and no joint far from where it is."""
        cell, m, rows = self.cell, len(touches), touches.expected_rows(self.cell)
        robot = cell.robot
        faces = [touches.faces[i] for i in touches.face]
        room = 1 + self.margins.overtravel[touches.face] / cell.touch.approach
        sides = [np.concatenate([f.normal, f.origin, f.u, f.v]) for f in faces]
        p = np.column_stack([np.array(sides), rows.sigma, room, self._shared(rows)])
        lower, upper = (np.tile(limit, (m, 1)) for limit in (robot.lower + HAIR, robot.upper - HAIR))
        far = FAR * np.where(robot.prismatic, LEVER, 1.0)
        low, high = np.maximum(lower, touches.q - far), np.minimum(upper, touches.q + far)
        inset = self.margins.inset[touches.face] / np.stack([f.size for f in faces])
        zero, lean = np.zeros((m, 1)), np.full((m, 1), np.cos(cell.touch.max_tilt - HAIR))
        straight = np.zeros((m, self.constraints.shape[0] - 4 - lower.shape[1]))
        return Numbers(
            x=np.hstack([touches.q, touches.approach]),
            p=p,
            x_limits=np.stack([np.hstack([low, lower]), np.hstack([high, upper])]),
            g_limits=np.stack(
                [
                    np.hstack([zero, inset, lean, straight, lower]),
                    np.hstack([zero, 1 - inset, zero + 1, straight, upper]),
                ]
            ),
        )

    def _shared(self, rows: Rows) -> Float[np.ndarray, "touches k"]:
        """What unknowns that touches share add to their rows."""
        unknowns = self.coordinates.prior.unknowns
        slopes = unknowns.shared_slopes(rows, self.coordinates.theta) / rows.sigma[:, None]
        return slopes @ self.coordinates.basis[len(unknowns.parameters) :]

    def _pose(self, q: ca.SX, theta: ca.SX, conditions: ca.SX | None = None) -> tuple[ca.SX, ca.SX]:
        T = jig_T_tip(self.cell.robot, q, theta, ca.SX.eye(4)[:3, :], ca.SX([[0, 0, 0, 1]]), conditions)
        return T[:, 3], T[:, :3]

    def _height(self, height: ca.SX, lean: ca.SX) -> ca.SX:
        """Distance of the end of the wire from the face, as in the model of a touch."""
        wire = self.cell.wire
        if wire.flat:
            return height - wire.flat * ca.sqrt(ca.fmax(1 - lean**2, 1e-12))
        return height - wire.ball

    def _held(self, tip: ca.SX, R: ca.SX, high: ca.SX, turned: ca.SX, way: ca.SX) -> list[ca.SX]:
        """What is zero where the approach holds the same wire off the face: as much as the robot's joints can keep."""
        joints = len(self.cell.robot.joints)
        rest = (turned.T @ R - R.T @ turned) / 2
        turn = ca.vertcat(rest[2, 1], rest[0, 2], rest[1, 0])
        return [high - tip - way, turn if joints > 5 else turn[:2] if joints == 5 else ca.SX(0, 1)]
