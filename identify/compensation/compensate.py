"""Use a calibration: the joints that bring the true tip where it is wanted, and the poses that make a controller go."""

from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from identify.compensation.ipopt import solve
from identify.compensation.postures import nominal, regular_branch
from identify.compensation.trust import RESIDUAL, joint_change, reasons, turned_around
from identify.model.files import InputError
from identify.model.frames import inverse, pose, transform
from identify.model.ik import Reach, reach, wrapped
from identify.model.io.calibration_file import Calibration

CHANGE = 3 * np.pi / 180  # [rad], or LEVER times that [mm]: the change of a joint that needs no asking
USUAL = 3.0  # times the usual change of a robot that is far off, where that is more
SAMPLES = 300  # postures that tell what is usual
SINGULAR = (
    0.1  # smallest singular value of the pose Jacobian, lengths in LEVER, below which a posture is called singular
)
TURN = 4 * np.pi  # [rad] of an angle of a pose, beyond which degrees were meant
SHIFT = 0.05  # [mm] or [deg] of the base, that is worth a word
HARD = 100  # targets at most that are handed to Ipopt, at some 10 milliseconds each

Place = Literal["jig", "base"] | Float[np.ndarray, " 6"]
Hold = Literal["jig", "robot"]


@dataclass(frozen=True, eq=False)
class Compensation:
    """Targets corrected, and those left as they were."""

    nominal: Float[np.ndarray, "targets joints"]
    """Where the controller would go uncorrected; NaN where it cannot."""
    q: Float[np.ndarray, "targets joints"]
    """Where it is to go [rad] or [mm]; `nominal` where left alone."""
    command: Float[np.ndarray, "targets 6"]
    """What to tell it, in the frame of the targets; the target where left alone."""
    residual: Float[np.ndarray, " targets"]
    """[mm] of inverse kinematics, orientation errors counted with LEVER."""
    why: tuple[str, ...]
    """Why a target was left alone; empty where it was corrected."""

    @property
    def corrected(self) -> Bool[np.ndarray, " targets"]:
        """Which targets were corrected."""
        return np.array([not reason for reason in self.why], dtype=bool)

    def left(self) -> dict[str, int]:
        """How many targets were left alone, by what stands before the first colon of the reason."""
        return dict(Counter(reason.split(":")[0] for reason in self.why if reason).most_common())


def believed(calibration: Calibration) -> Float[np.ndarray, " parameters"]:
    """The parameters that the robot controller computes with: the cell's.

    A base or a tool that the cell leaves open (fit) is believed to be the identified one: it has to be entered in the
    controller before anything else.
    """
    cell, theta = calibration.cell, calibration.cell.theta.copy()
    theta[:6] = calibration.theta[:6] if cell.base is None else theta[:6]
    theta[-6:] = calibration.theta[-6:] if cell.tool is None else theta[-6:]
    return theta


def compensate(
    calibration: Calibration,
    poses: Float[np.ndarray, "targets 6"],
    *,
    frame: Place = "jig",
    fixed_to: Hold = "jig",
    near: Float[np.ndarray, " joints"] | Float[np.ndarray, "targets joints"] | None = None,
    free_roll: bool = False,
    max_change: float | None = None,
) -> Compensation:
    """Joints and commands that bring the identified robot's tip to poses [mm, rad], nearest to where it would go now.

    `frame` is the jig, the robot's base, or a user frame as a pose in the base. Poses `fixed_to` the jig stand still
    where the base was found somewhere else; those fixed to the robot move with it. `near` is a posture to look for
    solutions from, for all targets or one each, that of `regular_branch` if not given. `free_roll` leaves the turn
    about the wire open. A target is left alone and says why where the residual is not below RESIDUAL, a limit is
    passed, or a joint would change by more than `max_change` [rad]; not given, that is CHANGE, or for a robot that is
    far off USUAL times what is usual for it.
    """
    cell, nominal_theta = calibration.cell, believed(calibration)
    turn = float(np.abs(poses[:, 3:]).max(initial=0.0))
    if turn > TURN:
        raise InputError(f"an angle of a pose is {turn:.4g} rad: degrees? functions take radians, np.radians(angles)")
    if near is not None:
        cell.robot.require_radians(near)
    there = wanted_frame(calibration, frame, fixed_to) @ transform(poses)
    command_frame = jig_T_frame(nominal_theta, frame)
    before, why = _before(calibration, command_frame @ transform(poses), near)
    reached = _bring(calibration, there, before, ~np.isnan(before[:, 0]), free_roll)
    limit = allowed_change(calibration, fixed_to) if max_change is None else max_change
    for i, reason in reasons(cell.kinematics, nominal_theta, before, reached, limit):
        why[i] = reason
    unchanged = np.array([bool(reason) for reason in why], dtype=bool)
    q = np.where(unchanged[:, None], before, reached.q)
    command = poses.copy()
    command[~unchanged] = pose(
        inverse(command_frame) @ tip_transform(calibration, reached.q[~unchanged], nominal_theta)
    )
    return Compensation(before, q, command, reached.residual, tuple(why))


def remarks(calibration: Calibration, fixed_to: Hold) -> list[str]:
    """What has to be known before corrected poses in the base or in user frames are used."""
    cell = calibration.cell
    opened = [part for part, frame in (("base", cell.base), ("tool", cell.tool)) if frame is None]
    sentences = (
        [f"the cell leaves the {' and the '.join(opened)} open: enter what was identified first"] if opened else []
    )
    if cell.base is not None and fixed_to == "jig":
        apart = inverse(transform(cell.theta[:6])) @ transform(calibration.theta[:6])
        distance = float(np.linalg.norm(apart[:3, 3]))
        angle = np.degrees(np.arccos(min(1.0, (np.trace(apart) - 2) / 2)))
        if distance > SHIFT or angle > SHIFT:
            sentences.append(
                f"the base was found {distance:.2f} mm and {angle:.2f} degrees from where the cell file puts it, and "
                "points are taken to stand with the jig; if they stand with the robot, which taught their frames, give "
                "compensate --fixed-to robot, or fix --setup with `fixed_to: robot`"
            )
    return sentences


def jig_T_frame(theta: Float[np.ndarray, " parameters"], frame: Place) -> Float[np.ndarray, "4 4"]:
    """The jig, the base or a user frame seen from the jig, for a robot of these parameters."""
    if isinstance(frame, str):
        return np.eye(4) if frame == "jig" else transform(theta[:6])
    return transform(theta[:6]) @ transform(frame)


def wanted_frame(calibration: Calibration, frame: Place, fixed_to: Hold) -> Float[np.ndarray, "4 4"]:
    """The frame of the targets where it truly is, seen from the jig."""
    return jig_T_frame(calibration.theta if fixed_to == "robot" else believed(calibration), frame)


def tip_transform(
    calibration: Calibration, q: Float[np.ndarray, "poses joints"], theta: Float[np.ndarray, " parameters"]
) -> Float[np.ndarray, "poses 4 4"]:
    """jig_T_tip of a robot of these parameters."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    if len(q):
        T[:, :3, 3], T[:, :3, :3] = calibration.cell.kinematics.tip(q, theta)
    return T


@lru_cache(maxsize=8)
def allowed_change(calibration: Calibration, fixed_to: Hold = "jig") -> float:
    """The joint change [rad] beyond which a target is left alone: three degrees, or three times what is usual.

    Usual is the median, over postures drawn from all that the joints allow, of the largest change of a joint.
    """
    robot, theta = calibration.cell.robot, believed(calibration)
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (SAMPLES, len(robot.joints)))
    shift = wanted_frame(calibration, "base", fixed_to) @ inverse(jig_T_frame(theta, "base"))
    T = shift @ tip_transform(calibration, q, theta)
    reached = reach(calibration.cell.kinematics, calibration.theta, T[:, :3, 3], T[:, :3, :3], q)
    usual = float(np.median(joint_change(robot, q, reached.q).max(axis=1)))
    return max(CHANGE, USUAL * usual)


def _before(
    calibration: Calibration, T: Float[np.ndarray, "targets 4 4"], near: np.ndarray | None
) -> tuple[Float[np.ndarray, "targets joints"], list[str]]:
    """Where the controller would go uncorrected, NaN where it cannot, and why it cannot."""
    robot = calibration.cell.robot
    if near is not None and near.shape not in {(len(robot.joints),), (len(T), len(robot.joints))}:
        raise InputError(f"near has shape {near.shape}, expected {len(robot.joints)} joints, or that for every target")
    kinematics, theta = calibration.cell.kinematics, believed(calibration)
    start = regular_branch(kinematics, theta, T) if near is None and len(T) else near
    q, reached = nominal(kinematics, theta, T, start)
    q[~reached] = np.nan
    return q, ["" if ok else "out of reach: the nominal robot has no solution within its limits" for ok in reached]


def _bring(
    calibration: Calibration,
    T: Float[np.ndarray, "targets 4 4"],
    before: Float[np.ndarray, "targets joints"],
    usable: Bool[np.ndarray, " targets"],
    free_roll: bool,
) -> Reach:
    """Joints of the identified robot for poses in the jig, from where it stands now; the hard ones with Ipopt."""
    kinematics, theta = calibration.cell.kinematics, calibration.theta
    q, residual = before.copy(), np.full(len(T), np.inf)
    inside = np.zeros(len(T), dtype=bool)
    if usable.any():
        p, R = T[usable, :3, 3], T[usable, :3, :3]
        reached = reach(kinematics, theta, p, R, before[usable], free_roll=free_roll)
        q[usable], residual[usable], inside[usable] = reached.q, reached.residual, reached.within_limits
    # an arm without a joint to spare has no other solution near: of 540 that were not reached Ipopt found 28, all more
    # than 18 degrees away
    spare = len(calibration.cell.robot.joints) > (5 if free_roll else 6)
    stuck = (residual >= RESIDUAL) | ~inside | turned_around(calibration.cell.robot, before, q).any(axis=1)
    open_ = np.flatnonzero(usable & stuck)[:HARD] if spare else np.empty(0, dtype=int)
    if len(open_):
        p, R = T[open_, :3, 3], T[open_, :3, :3]
        tried = wrapped(kinematics, solve(calibration.cell.robot, theta, p, R, before[open_], free_roll))
        again = reach(kinematics, theta, p, R, tried, free_roll=free_roll)
        better = again.reached(RESIDUAL)
        q[open_[better]], residual[open_[better]], inside[open_[better]] = again.q[better], again.residual[better], True
    return Reach(q, residual, inside)
