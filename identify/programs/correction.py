"""From positions of a program to positions that bring the identified robot there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from identify.compensation.compensate import Compensation, believed, compensate, tip_transform
from identify.model.frames import inverse, pose, transform
from identify.model.ik import within
from identify.model.io.calibration_file import Calibration
from identify.programs.frames_and_tools import Place, places
from identify.programs.orientation import euler_near, from_euler, from_quaternion, quaternion_near
from identify.programs.posture import Choice, Chooser, Fits
from identify.programs.records import Maker, Postures, Record
from identify.programs.setup import Setup, counting

AMBIGUOUS = 0.01  # [mm], by which the corrections of postures may differ before it matters which is meant


@dataclass(frozen=True, eq=False)
class Corrected:
    """What becomes of one position."""

    record: Record
    values: Float[np.ndarray, " numbers"] | None = None  # in the record's order and units; None: left alone
    move: Float[np.ndarray, " 3"] | None = None  # [mm] in the base, from the pose commanded before to that after
    why: str = ""  # why it is left alone
    notes: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()  # frame and tool that nobody states

    @property
    def shift(self) -> float:
        """How far the commanded pose moves [mm]."""
        return 0.0 if self.move is None else float(np.linalg.norm(self.move))


def correct(calibration: Calibration, records: Sequence[Record], maker: Maker, setup: Setup) -> list[Corrected]:
    """What becomes of positions of one maker's program, in their order."""
    work = _Work(calibration, maker, setup)
    cartesian = [i for i, record in enumerate(records) if record.kind != "joints"]
    joints = [i for i, record in enumerate(records) if record.kind == "joints"]
    corrections = dict(zip(cartesian, work.poses([records[i] for i in cartesian]), strict=True))
    corrections |= dict(zip(joints, work.joints([records[i] for i in joints]), strict=True))
    return [corrections[i] for i in range(len(records))]


def frame_T_tool(record: Record, values: Float[np.ndarray, " numbers"]) -> Float[np.ndarray, "4 4"]:
    """The pose that numbers of a record say [mm]."""
    T = np.eye(4)
    T[:3, 3] = values[:3]
    T[:3, :3] = from_euler(values[3:]) if record.kind == "euler" else from_quaternion(values[3:])
    return T


class _Work:
    """A calibration, and how a maker counts its robot's joints."""

    def __init__(self, calibration: Calibration, maker: Maker, setup: Setup) -> None:
        self.calibration, self.maker, self.setup = calibration, maker, setup
        robot = calibration.cell.robot
        self.theta, self.robot = believed(calibration), replace(robot, counting=counting(robot, setup, maker.coupled))
        self.chooser = Chooser(calibration.cell.kinematics, self.theta, self.robot)

    def poses(self, records: Sequence[Record]) -> list[Corrected]:
        """Positions in space."""
        where = places(records, self.setup, transform(self.theta[-6:]))
        reasons = [record.why or place.why for record, place in zip(records, where, strict=True)]
        usable = [i for i, why in enumerate(reasons) if not why]
        corrections = dict(
            zip(usable, self._poses([records[i] for i in usable], [where[i] for i in usable]), strict=True)
        )
        return [corrections.get(i) or Corrected(record, why=reasons[i]) for i, record in enumerate(records)]

    def _poses(self, records: Sequence[Record], where: Sequence[Place]) -> list[Corrected]:
        if not records:
            return []
        pairs = list(zip(records, where, strict=True))
        goal = np.array([place.base_T_tip(frame_T_tool(record, record.values)) for record, place in pairs])
        open_ = self.setup.near is None and self.setup.posture == "flags"
        choices = self.chooser.choose(
            transform(self.theta[:6]) @ goal,
            [self._fits(record.flags) for record in records],
            self.setup.near,
            [open_ and record.flags is None for record in records],
        )
        result = self._compensate(goal, np.array([choice.q for choice in choices]))
        command = transform(result.command)
        apart = self._apart(goal, choices, command) if open_ else np.zeros(len(records))
        after = self.chooser.postures(np.nan_to_num(result.q))
        still = [bool(self._fits(r.flags)(after.take(slice(i, i + 1)))[0]) for i, r in enumerate(records)]
        why = [
            _choice_why(choice, apart[i]) or result.why[i] or self._flags_why(still[i])
            for i, choice in enumerate(choices)
        ]
        return [
            Corrected(record, why=why[i], assumed=place.assumptions)
            if why[i]
            else self._moved(record, place, goal[i], command[i], still[i])
            for i, (record, place) in enumerate(pairs)
        ]

    def _apart(
        self,
        goal: Float[np.ndarray, "records 4 4"],
        choices: Sequence[Choice],
        command: Float[np.ndarray, "records 4 4"],
    ) -> Float[np.ndarray, " records"]:
        """How far apart [mm] the commands are that the other postures would get, of those that fit as well."""
        owner = [i for i, choice in enumerate(choices) for _ in choice.others]
        apart = np.zeros(len(choices))
        if owner:
            others = self._compensate(goal[owner], np.array([q for choice in choices for q in choice.others]))
            way = np.linalg.norm(others.command[:, :3] - command[owner, :3, 3], axis=1)
            np.maximum.at(apart, owner, np.where(others.corrected, way, 0.0))
        return apart

    def _moved(self, record: Record, place: Place, before: np.ndarray, after: np.ndarray, still: bool) -> Corrected:
        """A position corrected."""
        T = place.frame_T_tool(after)
        near = euler_near if record.kind == "euler" else quaternion_near
        values = np.concatenate([T[:3, 3], near(T[:3, :3], record.values[3:])])
        notes = () if still else (f"{record.name}: {_CROSSED}",)
        return Corrected(record, values, after[:3, 3] - before[:3, 3], notes=notes, assumed=place.assumptions)

    def joints(self, records: Sequence[Record]) -> list[Corrected]:
        """Positions of the joints."""
        count = len(self.robot.joints)
        reasons = [record.why or _count_why(record, count) for record in records]
        usable = [i for i, why in enumerate(reasons) if not why]
        if not usable:
            return [Corrected(record, why=why) for record, why in zip(records, reasons, strict=True)]
        scale = np.array([np.ones(count) if records[i].per_degree is None else records[i].per_degree for i in usable])
        q = self.robot.from_controller(np.array([records[i].values for i in usable]) / scale)
        T = inverse(transform(self.theta[:6])) @ tip_transform(self.calibration, q, self.theta)
        result = self._compensate(T, q)
        values, inside = self.robot.to_controller(result.q) * scale, within(self.robot, q)
        move = result.command[:, :3] - T[:, :3, 3]
        corrections = dict[int, Corrected]()
        for k, i in enumerate(usable):
            why = result.why[k] if inside[k] else "joint limit: it stands beyond the limits of the model"
            corrections[i] = Corrected(records[i], why=why) if why else Corrected(records[i], values[k], move[k])
        return [corrections.get(i) or Corrected(record, why=reasons[i]) for i, record in enumerate(records)]

    def _compensate(self, base_T_tip: np.ndarray, q: np.ndarray) -> Compensation:
        return compensate(
            self.calibration, pose(base_T_tip), frame="base", fixed_to=self.setup.fixed_to, near=np.nan_to_num(q)
        )

    def _fits(self, flags: Any) -> Fits:
        return _all if flags is None or self.setup.posture == "nearest" else partial(self.maker.fits, flags)

    def _flags_why(self, still: bool) -> str:
        """Why a position whose flags do not describe its corrected joints is left alone, where they bind."""
        return "" if still or not self.maker.binding else f"posture: {_CROSSED}"


_CROSSED = "corrected, its joints are not those that its posture flags describe"


def _choice_why(choice: Choice, apart: float) -> str:
    """Why no posture can be chosen."""
    if not choice.solved:
        return "out of reach: the nominal robot has no solution within its limits; are frame and tool right?"
    if not choice.fits:
        cure = "are signs and zeros of the joints those of the program? posture: nearest leaves the flags aside"
        return f"posture: no solution of the nominal robot is as the flags say; {cure}"
    if apart > AMBIGUOUS:
        return f"posture: several fit, {apart:.3g} mm apart when corrected; write near_deg: [...] to say which is meant"
    return ""


def _count_why(record: Record, count: int) -> str:
    present = len(record.numbers)
    return "" if present == count else f"joints: it has {present}, the robot of the calibration {count}"


def _all(postures: Postures) -> Bool[np.ndarray, " solutions"]:
    return np.ones(len(postures.degrees), dtype=bool)
