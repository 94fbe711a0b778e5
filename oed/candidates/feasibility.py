"""Whether a touch can be made: at contact, on the way from the approach, and on the search beyond."""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.ik import reach, within
from oed.candidates.edge_margins import Margins
from probe.motion.clearance import CLEAR, MARGIN, WIRE, Clearance
from probe.motion.obstacles import owners
from probe.motion.torch import STICKOUT

TOLERANCE = 1e-4  # [mm], how well inverse kinematics meets contact and approach
TURN = 0.5  # [rad], most that a joint may turn between approach and contact
ADVANCE = 0.3  # of the way that the tip should gain along the normal, the least that it does gain, all along
BRINK = 1.0  # [mm], that the tip stays within the edges on its way, which bends a little
FINEST = 5.0  # [mm], least margin for which the way is looked at more often


class Verdict(IntEnum):
    """What a touch fails at first."""

    FINE = 0
    TILT = 1
    LIMITS = 2
    EDGE = 3
    JIG = 4
    ARM = 5
    APPROACH = 6
    SEARCH = 7
    PATH = 8
    WIRE = 9


@dataclass(frozen=True, eq=False)
class Judge:
    """Judges touches of a cell by a model of its robot."""

    cell: Cell
    theta: Float[np.ndarray, " parameters"]
    margins: Margins
    margin: float = MARGIN  # [mm], clearance of arm and torch

    @cached_property
    def clearance(self) -> Clearance:
        """Arm and torch among the obstacles."""
        return Clearance(self.cell, self.theta)

    @cached_property
    def _owners(self) -> Bool[np.ndarray, "faces obstacles"]:
        assert self.cell.jig is not None
        return owners(self.cell.jig, self.clearance.solids)

    @cached_property
    def _frames(self) -> Float[np.ndarray, "faces 3 3"]:
        assert self.cell.jig is not None
        return np.stack([[f.u / f.size[0], f.v / f.size[1], f.normal] for f in self.cell.jig.faces])

    def touch(
        self, face: Int[np.ndarray, " touches"], q: Float[np.ndarray, "touches joints"]
    ) -> tuple[Float[np.ndarray, "touches joints"], Int[np.ndarray, " touches"]]:
        """Joint values of the approach to contacts on faces, and verdicts on the touches so made."""
        verdict, approach = self.contact(face, q), q.copy()
        left = np.flatnonzero(verdict == Verdict.FINE)
        approach[left], exists = self.approach(face[left], q[left])
        verdict[left[~exists]] = Verdict.APPROACH
        left = left[exists]
        verdict[left] = self.way(face[left], q[left], approach[left])
        return approach, verdict

    def verdict(
        self,
        face: Int[np.ndarray, " touches"],
        q: Float[np.ndarray, "touches joints"],
        approach: Float[np.ndarray, "touches joints"],
    ) -> Int[np.ndarray, " touches"]:
        """Verdicts on touches with approaches of their own."""
        verdict = self.contact(face, q)
        left = np.flatnonzero(verdict == Verdict.FINE)
        verdict[left] = self.way(face[left], q[left], approach[left])
        return verdict

    def contact(
        self, face: Int[np.ndarray, " touches"], q: Float[np.ndarray, "touches joints"]
    ) -> Int[np.ndarray, " touches"]:
        """Verdicts on the postures at contact alone: tilt, joint limits, edges of the face, clearance."""
        tip, R = self.cell.kinematics.tip(q, self.theta)
        lean = -(R[:, :, 2] * self._frames[face, 2]).sum(axis=1)
        out = np.where(lean < np.cos(self.cell.touch.max_tilt) - 1e-8, Verdict.TILT, Verdict.FINE)
        out[(out == 0) & ~within(self.cell.robot, q)] = Verdict.LIMITS
        out[(out == 0) & ~self._inside(face, tip, self.margins.inset[face] - TOLERANCE)] = Verdict.EDGE
        return self._clear(face, q, out)

    def approach(
        self, face: Int[np.ndarray, " touches"], q: Float[np.ndarray, "touches joints"]
    ) -> tuple[Float[np.ndarray, "touches joints"], Bool[np.ndarray, " touches"]]:
        """Joint values of the same wire held off the face by the approach distance, and whether they exist."""
        joints = len(self.cell.robot.joints)
        tip, R = self.cell.kinematics.tip(q, self.theta)
        above = tip + self.cell.touch.approach * self._frames[face, 2]
        found = reach(
            self.cell.kinematics, self.theta, above, R, q, free_roll=joints == 5, free_orientation=joints < 5,
            iterations=8, tolerance=TOLERANCE / 10,
        )  # fmt: skip
        turn = np.where(self.cell.robot.prismatic, 0.0, np.abs(found.q - q)).max(axis=1)
        return found.q, found.reached(TOLERANCE) & (turn < TURN)

    def way(
        self,
        face: Int[np.ndarray, " touches"],
        q: Float[np.ndarray, "touches joints"],
        approach: Float[np.ndarray, "touches joints"],
    ) -> Int[np.ndarray, " touches"]:
        """Verdicts on the way from approach through contact to the end of the search, straight in joint space.

        Clearance is looked at so often that the tip goes no further than 1.5 margins in between. Beyond the contact the
        robot goes only if the face is further away than the model has it, and then so is the jig: there the tip must
        stay over the face, and the joints within their limits.
        """
        room = 1 + self.margins.overtravel[face] / self.cell.touch.approach  # where the search ends; contact is 1
        end = approach + room[:, None] * (q - approach)
        out = np.where(within(self.cell.robot, approach), Verdict.FINE, Verdict.APPROACH)
        out[(out == 0) & ~within(self.cell.robot, end)] = Verdict.SEARCH
        half, late = (approach + q) / 2, (q + end) / 2
        tips = [self.cell.kinematics.tip(at, self.theta) for at in (approach, half, q, late, end)]
        out[(out == 0) & ~self._over(face, [p for p, _ in tips], room)] = Verdict.PATH
        for tip, R in tips[:3]:
            out[(out == 0) & ~self._wire(face, tip, R[:, :, 2])] = Verdict.WIRE
        steps = max(2, int(np.ceil(self.cell.touch.approach / (1.5 * max(self.margin, FINEST)))))
        for k in range(steps):
            out = self._clear(face, approach + k / steps * (q - approach), out)
        return out

    def _clear(
        self, face: Int[np.ndarray, " touches"], q: Float[np.ndarray, "touches joints"], so_far: np.ndarray
    ) -> Int[np.ndarray, " touches"]:
        """Add what collides to verdicts that are fine so far."""
        out, left = so_far.copy(), np.flatnonzero(so_far == Verdict.FINE)
        hit = self.clearance.hits(q[left], self._owners[face[left]], self.margin)
        itself = hit == len(self.clearance.solids)
        out[left] = np.where(hit == CLEAR, Verdict.FINE, np.where(itself, Verdict.ARM, Verdict.JIG))
        return out

    def _over(
        self, face: Int[np.ndarray, " touches"], tips: list[np.ndarray], room: Float[np.ndarray, " touches"]
    ) -> Bool[np.ndarray, " touches"]:
        """Whether the tip stays over its face and goes down all the time."""
        height = [(p * self._frames[face, 2]).sum(axis=1) for p in tips]
        half = np.full(len(face), 0.5)
        ok = np.logical_and.reduce([self._inside(face, p, np.full((len(face), 2), BRINK)) for p in tips])
        for a, b, share in zip(height[:-1], height[1:], (half, half, (room - 1) / 2, (room - 1) / 2), strict=True):
            ok &= a - b >= ADVANCE * share * self.cell.touch.approach
        return np.asarray(ok)

    def _inside(
        self,
        face: Int[np.ndarray, " touches"],
        p: Float[np.ndarray, "touches 3"],
        inset: Float[np.ndarray, "touches 2"],
    ) -> Bool[np.ndarray, " touches"]:
        """Whether points lie over their faces, so far from the edges along u and v [mm]."""
        assert self.cell.jig is not None
        origin, size = (np.stack([getattr(f, key) for f in self.cell.jig.faces])[face] for key in ("origin", "size"))
        place = np.einsum("mij,mj->mi", self._frames[face, :2], p - origin)
        return np.asarray(((place >= inset) & (place <= size - inset)).all(axis=1))

    def _wire(
        self,
        face: Int[np.ndarray, " touches"],
        tip: Float[np.ndarray, "touches 3"],
        wire: Float[np.ndarray, "touches 3"],
    ) -> Bool[np.ndarray, " touches"]:
        """Whether nothing is nearer to the bare wire than half its height over the face it is to touch, or WIRE."""
        assert self.cell.jig is not None
        offset = np.array([f.offset for f in self.cell.jig.faces])[face]
        low = tip - STICKOUT / 3 * wire
        height = (low * self._frames[face, 2]).sum(axis=1) - offset
        need = np.minimum(WIRE, height / 2)
        ok = np.ones(len(face), dtype=bool)
        for solid in self.clearance.solids:
            ok &= solid.segment(low.T, (tip - STICKOUT * wire).T) >= need
        return ok
