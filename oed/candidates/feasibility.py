"""Whether a touch can be made: at contact, on the way from the approach, and on the search beyond."""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell
from identify.model.ik import reach, within
from oed.candidates.edge_margins import EDGE, Margins
from probe.motion.clearance import CLEAR, MARGIN, WIRE, Clearance
from probe.motion.obstacles import owners
from probe.motion.torch import STICKOUT

TOLERANCE = 1e-4  # [mm], how well inverse kinematics meets contact and approach
TURN = 0.5  # [rad], most that a joint may turn between approach and contact
ADVANCE = 0.3  # of the way that the tip should gain along the normal, the least that it does gain, all along
BRINK = 1.0  # [mm], that the tip stays within the edges on its way, which bends a little
STARTS = 60  # postures tried for a face that was never reached
FINEST = 5.0  # [mm], least margin for which the way is looked at more often


class Infeasibility(IntEnum):
    """What a touch fails at first."""

    NONE = 0
    TILT = 1
    LIMITS = 2
    EDGE = 3
    JIG = 4
    ARM = 5
    APPROACH = 6
    SEARCH = 7
    PATH = 8
    WIRE = 9


FAILURES = {
    Infeasibility.TILT: "lean too far",
    Infeasibility.LIMITS: "lie beyond the joint limits",
    Infeasibility.EDGE: "touch too near to an edge",
    Infeasibility.JIG: "bring arm or torch too near to the jig or the table",
    Infeasibility.ARM: "bring arm and torch too near to each other",
    Infeasibility.APPROACH: "have no approach before them",
    Infeasibility.SEARCH: "leave no room within the joint limits to search beyond the contact",
    Infeasibility.PATH: "lead the tip off the face on the way",
    Infeasibility.WIRE: "bring the bare wire to something else first",
}


@dataclass(frozen=True, eq=False)
class Feasibility:
    """Whether touches of a cell can be made, by a model of its robot."""

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
        return owners(self.cell.the_jig, self.clearance.solids)

    @cached_property
    def _frames(self) -> Float[np.ndarray, "faces 3 3"]:
        return np.stack([[f.u / f.size[0], f.v / f.size[1], f.normal] for f in self.cell.the_jig.faces])

    def touch(
        self, face: Int[np.ndarray, " touches"], q: Float[np.ndarray, "touches joints"]
    ) -> tuple[Float[np.ndarray, "touches joints"], Int[np.ndarray, " touches"]]:
        """Joint values of the approach to contacts on faces, and what each such touch fails at first."""
        infeasibility, approach = self.contact(face, q), q.copy()
        feasible = np.flatnonzero(infeasibility == Infeasibility.NONE)
        approach[feasible], exists = self.approach(face[feasible], q[feasible])
        infeasibility[feasible[~exists]] = Infeasibility.APPROACH
        feasible = feasible[exists]
        infeasibility[feasible] = self.way(face[feasible], q[feasible], approach[feasible])
        return approach, infeasibility

    def check(
        self,
        face: Int[np.ndarray, " touches"],
        q: Float[np.ndarray, "touches joints"],
        approach: Float[np.ndarray, "touches joints"],
    ) -> Int[np.ndarray, " touches"]:
        """What touches with approaches of their own fail at first."""
        infeasibility = self.contact(face, q)
        feasible = np.flatnonzero(infeasibility == Infeasibility.NONE)
        infeasibility[feasible] = self.way(face[feasible], q[feasible], approach[feasible])
        return infeasibility

    def contact(
        self, face: Int[np.ndarray, " touches"], q: Float[np.ndarray, "touches joints"]
    ) -> Int[np.ndarray, " touches"]:
        """What the postures at contact alone fail at first: tilt, joint limits, edges of the face, clearance."""
        tip, R = self.cell.kinematics.tip(q, self.theta)
        lean = -(R[:, :, 2] * self._frames[face, 2]).sum(axis=1)
        out = np.where(lean < np.cos(self.cell.touch.max_tilt) - 1e-8, Infeasibility.TILT, Infeasibility.NONE)
        out[(out == 0) & ~within(self.cell.robot, q)] = Infeasibility.LIMITS
        out[(out == 0) & ~self._inside(face, tip, self.margins.inset[face] - TOLERANCE)] = Infeasibility.EDGE
        return self._clear(face, q, out)

    def approach(
        self, face: Int[np.ndarray, " touches"], q: Float[np.ndarray, "touches joints"]
    ) -> tuple[Float[np.ndarray, "touches joints"], Bool[np.ndarray, " touches"]]:
        """Joint values of the same wire held off the face by the approach distance, and whether they exist."""
        joints = len(self.cell.robot.joints)
        tip, R = self.cell.kinematics.tip(q, self.theta)
        above = tip + self.cell.touch.approach * self._frames[face, 2]
        ends = reach(
            self.cell.kinematics,
            self.theta,
            above,
            R,
            q,
            free_roll=joints == 5,
            free_orientation=joints < 5,
            iterations=8,
            tolerance=TOLERANCE / 10,
        )
        turn = np.where(self.cell.robot.prismatic, 0.0, np.abs(ends.q - q)).max(axis=1)
        return ends.q, ends.reached(TOLERANCE) & (turn < TURN)

    def way(
        self,
        face: Int[np.ndarray, " touches"],
        q: Float[np.ndarray, "touches joints"],
        approach: Float[np.ndarray, "touches joints"],
    ) -> Int[np.ndarray, " touches"]:
        """What the search fails at first, straight in joint space from the approach through the contact to its end.

        Clearance is looked at so often that the tip goes no further than 1.5 margins in between. Beyond the contact the
        robot goes only if the face is further away than the model has it, and then so is the jig: there the tip must
        stay over the face, and the joints within their limits.
        """
        room = 1 + self.margins.overtravel[face] / self.cell.touch.approach  # where the search ends; contact is 1
        end = approach + room[:, None] * (q - approach)
        out = np.where(within(self.cell.robot, approach), Infeasibility.NONE, Infeasibility.APPROACH)
        out[(out == 0) & ~within(self.cell.robot, end)] = Infeasibility.SEARCH
        half, late = (approach + q) / 2, (q + end) / 2
        tips = [self.cell.kinematics.tip(at, self.theta) for at in (approach, half, q, late, end)]
        out[(out == 0) & ~self._over(face, [p for p, _ in tips], room)] = Infeasibility.PATH
        for tip, R in tips[:3]:
            out[(out == 0) & ~self._wire(face, tip, R[:, :, 2])] = Infeasibility.WIRE
        steps = max(2, int(np.ceil(self.cell.touch.approach / (1.5 * max(self.margin, FINEST)))))
        for k in range(steps):
            out = self._clear(face, approach + k / steps * (q - approach), out)
        return out

    def _clear(
        self, face: Int[np.ndarray, " touches"], q: Float[np.ndarray, "touches joints"], so_far: np.ndarray
    ) -> Int[np.ndarray, " touches"]:
        """Add collisions to touches without an infeasibility so far."""
        out, feasible = so_far.copy(), np.flatnonzero(so_far == Infeasibility.NONE)
        hit = self.clearance.hits(q[feasible], self._owners[face[feasible]], self.margin)
        itself = hit == len(self.clearance.solids)
        out[feasible] = np.where(
            hit == CLEAR, Infeasibility.NONE, np.where(itself, Infeasibility.ARM, Infeasibility.JIG)
        )
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
        origin, size = (
            np.stack([getattr(f, key) for f in self.cell.the_jig.faces])[face] for key in ("origin", "size")
        )
        place = np.einsum("mij,mj->mi", self._frames[face, :2], p - origin)
        return np.asarray(((place >= inset) & (place <= size - inset)).all(axis=1))

    def _wire(
        self,
        face: Int[np.ndarray, " touches"],
        tip: Float[np.ndarray, "touches 3"],
        wire: Float[np.ndarray, "touches 3"],
    ) -> Bool[np.ndarray, " touches"]:
        """Whether nothing is nearer to the bare wire than half its height over the face it is to touch, or WIRE."""
        offset = np.array([f.offset for f in self.cell.the_jig.faces])[face]
        low = tip - STICKOUT / 3 * wire
        height = (low * self._frames[face, 2]).sum(axis=1) - offset
        need = np.minimum(WIRE, height / 2)
        above = need > 0
        return above & ~self.clearance.segments_near(low.T, (tip - STICKOUT * wire).T, np.where(above, need, 0.0))


def unreached(feasibility: Feasibility, tally: Int[np.ndarray, "faces infeasibilities"]) -> tuple[str, ...]:
    """A sentence for every face on which no touch was found; `tally` counts what postures that reach it fail at."""
    empty = np.flatnonzero(tally[:, Infeasibility.NONE] == 0)
    leaning = tally[:, Infeasibility.TILT] == tally.sum(axis=1)  # or not reached at all
    groups = dict[str, list[str]]()
    for i in empty.tolist():
        why = _unreached(feasibility, i) if leaning[i] else _refused(feasibility, i, tally[i])
        groups.setdefault(why, []).append(f"'{feasibility.cell.the_jig.faces[i].name}'")
    return tuple(
        f"face {names[0]} {why}" if len(names) == 1 else f"each of the faces {', '.join(names)} {why}"
        for why, names in groups.items()
    )


def _refused(feasibility: Feasibility, i: int, counts: Int[np.ndarray, " infeasibilities"]) -> str:
    """The face is reached, but no touch of it can be made."""
    order = sorted(Infeasibility, key=lambda v: -counts[v])
    most = [v for v in order if counts[v] >= 0.01 * counts.sum()]
    shares = ", ".join(f"{counts[v] / counts.sum():.0%} {FAILURES[v]}" for v in most)
    face = feasibility.cell.the_jig.faces[i]
    narrow = f"; it is only {face.size.min():.0f} mm wide" if face.size.min() < 4 * EDGE else ""
    return f"cannot be touched: of {counts.sum()} postures that reach it, {shares}{narrow}."


def _unreached(feasibility: Feasibility, i: int) -> str:
    """No posture within the limits of joints and tilt brings the tip to the face: how far off it stays."""
    cell = feasibility.cell
    face, robot = cell.the_jig.faces[i], cell.robot
    s, t = (x.ravel() for x in np.meshgrid([0.1, 0.5, 0.9], [0.1, 0.5, 0.9]))
    point = np.repeat(face.point(s, t), STARTS, axis=0)
    start = np.random.default_rng(4).uniform(robot.lower, robot.upper, (len(point), len(robot.joints)))
    R = np.broadcast_to(np.eye(3), (len(point), 3, 3))
    ends = reach(cell.kinematics, feasibility.theta, point, R, start, free_orientation=True, iterations=80)
    near = ends.residual < 0.01
    if not near.any():
        return (
            f"is out of reach: the tip comes no nearer than {ends.residual.min():.0f} mm; move the "
            "jig or the base, or check their poses in cell.yaml."
        )
    if not (near & ends.within_limits).any():
        return f"is reached only beyond the joint limits of robot '{robot.name}'."
    _, R = cell.kinematics.tip(ends.q[near & ends.within_limits], feasibility.theta)
    tilt = np.degrees(np.arccos(np.clip(-R[:, :, 2] @ face.normal, -1, 1).max()))
    return (
        f"is reached only with the wire about {tilt:.0f} degrees off its normal, more than "
        f"max_tilt_deg: {np.degrees(cell.touch.max_tilt):.0f}; turn the jig or bend the torch."
    )
