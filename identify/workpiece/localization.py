"""Where a workpiece stands: its pose in the frame of the base, from touches on its known faces, with uncertainty."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError
from identify.model.frames import pose, transform
from identify.model.io.calibration_file import Calibration
from identify.model.jig import Jig
from identify.model.measurement import rows
from identify.model.touch import Touches
from identify.uncertainty.posterior import posterior
from identify.workpiece.placement import Contacts, Placement, outside, settle, starts, unseen

FREEDOMS = 6
POLISH = 2  # rounds of weights from the robot's covariance at the pose found
BESIDE = 2.0  # [mm], 1 sigma of a contact beyond the edge of its face: chamfers, and faces drawn too small
APART = (2.0, 0.02)  # [mm], [rad]: poses that differ by more are different answers
UNLIKELY = 9.0  # chi-square by which an answer has to be worse than the best to be ruled out
ALARM = 0.001  # chance of residuals so large, below which the touches are said to disagree
HOPELESS = 20.0  # times more than stated, beyond which there is no answer


@dataclass(frozen=True, eq=False)
class Location:
    """A workpiece that was found."""

    workpiece: Jig
    base_T_workpiece: Float[np.ndarray, "4 4"]
    covariance: Float[np.ndarray, "6 6"]  # of a move [mm] and a rotation vector [rad] in the workpiece's own axes
    residuals: Mapping[str, float]  # id -> distance of the tip from its face [mm]
    deviations: Mapping[str, float]  # id -> what scatter and the robot's uncertainty allow for it [mm], 1 sigma
    chi2: float  # of the residuals, by their covariance
    chance: float  # of residuals so large where all is as stated; 1 where nothing is left to check
    notes: tuple[str, ...]

    @property
    def degrees(self) -> int:
        """Touches beyond those that determine the pose: what checks it."""
        return len(self.residuals) - FREEDOMS

    @property
    def pose(self) -> Float[np.ndarray, " 6"]:
        """x, y, z [mm], rz, ry, rx [rad] of the workpiece in the frame of the base."""
        return pose(self.base_T_workpiece)

    @property
    def sigma(self) -> Float[np.ndarray, " 6"]:
        """1 sigma of the position along the axes of the base [mm], and of turns about those of the workpiece [rad]."""
        R = self.base_T_workpiece[:3, :3]
        way = np.sqrt(np.diag(R @ self.covariance[:3, :3] @ R.T))
        return np.concatenate([way, np.sqrt(np.diag(self.covariance)[3:])])

    def point_sigma(self, point: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Root mean square error of where points of the workpiece are [mm]."""
        G = move_of(point)
        return np.sqrt(np.einsum("pik,kl,pil->p", G, self.covariance, G))


def move_of(point: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3 6"]:
    """How points of a body move with its way and its rotation vector, in its own axes."""
    x, y, z = point.T
    o = np.zeros(len(point))
    rows = [[o, z, -y], [-z, o, x], [y, -x, o]]
    turn = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=2)


def locate(
    calibration: Calibration, workpiece: Jig, touches: Touches, near: Float[np.ndarray, " 6"] | None = None
) -> Location:
    """The pose of a workpiece in the frame of the identified robot's base, from touches on its named faces.

    Starts from everywhere, or from the pose `near` [mm, rad] in the base. Touches are weighted by their scatter and by
    what the calibration leaves open of the robot, which they share. Raises InputError where they leave a freedom open,
    where they allow two answers, or where they have nothing to do with the workpiece.
    """
    if not len(touches):
        raise InputError("there is no touch of status hit to locate the workpiece by; make at least six")
    location = _found(calibration, workpiece, touches, near)
    if location.chance >= ALARM:
        return location
    culprit = _culprit(calibration, workpiece, touches, near)
    times = np.sqrt(location.chi2 / location.degrees)
    words = f"the touches of '{workpiece.name}' disagree {times:.1f} times more than scatter and robot allow: {culprit}"
    if times > HOPELESS:
        raise InputError(f"{words}; are their faces right, and is the workpiece as drawn?")
    return replace(
        location,
        covariance=location.covariance * times**2,
        notes=(*location.notes, f"{words}; intervals are widened by that"),
    )


def _culprit(calibration: Calibration, workpiece: Jig, touches: Touches, near: Float[np.ndarray, " 6"] | None) -> str:
    """The touch without which the others agree best."""
    chances = np.zeros(len(touches))
    for i in range(len(touches)):
        with suppress(InputError):
            rest = _found(calibration, workpiece, touches.take(np.arange(len(touches)) != i), near)
            chances[i] = rest.chance if rest.degrees else 0.0
    i = int(np.argmax(chances))
    if chances[i] < ALARM:
        return "no single touch is to blame"
    return f"without touch {touches.ids[i]} on '{touches.face[i]}' the others agree"


def _found(
    calibration: Calibration, workpiece: Jig, touches: Touches, near: Float[np.ndarray, " 6"] | None
) -> Location:
    touched = _contacts(calibration, touches)
    scatter = touches.sigma * calibration.noise
    begin = starts(touched, 1 / scatter) if near is None else _one(transform(near))
    ends = settle(touched, np.diag(1 / scatter), begin)
    at = _chosen(calibration, workpiece, touches, touched, scatter, ends)
    own = np.diag(scatter**2) + _faces(workpiece, touches)
    for _ in range(POLISH):
        S = own + _robot(calibration, touches, at)
        at = settle(touched, np.linalg.inv(np.linalg.cholesky(S)), at)
    return _location(workpiece, touches, touched, S, at)


def _one(T: Float[np.ndarray, "4 4"]) -> Placement:
    return Placement(T[None, :3, :3], T[None, :3, 3])


def _matrix(at: Placement) -> Float[np.ndarray, "4 4"]:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = at.R[0], at.p[0]
    return T


def _contacts(calibration: Calibration, touches: Touches) -> Contacts:
    """Touches with the tip where the identified robot had it, in the frame of its base."""
    cell, theta = calibration.cell, calibration.theta.copy()
    theta[:6] = 0.0
    tip, R = cell.kinematics.tip(touches.q, theta)
    equations = rows(cell.wire, [touches], cell.robot)
    return Contacts(equations.normal, equations.offset, tip, R[:, :, 2], equations.radius)


def _faces(workpiece: Jig, touches: Touches) -> Float[np.ndarray, "touches touches"]:
    """What touches on one face share: by how much the face is off its drawing [mm^2]."""
    names = np.array(touches.face)
    tolerance = np.array([workpiece.by_name[name].tolerance if name in workpiece.by_name else 0.0 for name in names])
    return np.where(names[:, None] == names, np.outer(tolerance, tolerance), 0.0)


def _robot(calibration: Calibration, touches: Touches, at: Placement) -> Float[np.ndarray, "touches touches"]:
    """Covariance of the residuals from what is not known of the robot [mm^2].

    It is that of the tip as the jig sees it, by the joint covariance of base, links and tool: what the calibration
    cannot tell of them apart, it need not tell apart here either.
    """
    cell, theta = calibration.cell, calibration.theta
    jig_T_workpiece = transform(theta[:6]) @ _matrix(at)
    equations = rows(cell.wire, [touches], cell.robot)
    normal = equations.normal @ jig_T_workpiece[:3, :3].T
    prior = posterior(calibration)
    unit_rows = replace(equations, normal=normal, sigma=np.ones(len(equations)), face=())
    B = prior.root(prior.unknowns.rows(unit_rows, theta))
    return B @ B.T


def _chosen(
    calibration: Calibration,
    workpiece: Jig,
    touches: Touches,
    touched: Contacts,
    scatter: Float[np.ndarray, " touches"],
    ends: Placement,
) -> Placement:
    """The one answer among the ends of the search; raises InputError where a freedom is open, or two answers fit."""
    r = ends.residual(touched)[0]
    beyond = _beyond(workpiece, touches, touched, ends)
    score = ((r / scatter) ** 2).sum(axis=1) + ((beyond / BESIDE) ** 2).sum(axis=1)
    score += np.where(outside(touched, ends) > 0, 0.0, 1e6)
    best = int(np.argmin(score))
    at = Placement(ends.R[[best]], ends.p[[best]])
    _require_sight(workpiece, touches, touched, at)
    away = np.linalg.norm(ends.p - at.p, axis=1)
    turn = np.arccos(np.clip((np.einsum("sij,ij->s", ends.R, at.R[0]) - 1) / 2, -1, 1))
    other = np.flatnonzero(((away > APART[0]) | (turn > APART[1])) & (score < score[best] + UNLIKELY))
    if len(other):
        second = Placement(ends.R[[other[0]]], ends.p[[other[0]]])
        raise InputError(
            f"two poses of the workpiece explain the touches: {said(_matrix(at))}, and {said(_matrix(second))}; make "
            "more touches, or say with --near which one is meant"
        )
    return at


def said(T: Float[np.ndarray, "4 4"]) -> str:
    """A pose as it is written behind --near and --frame: x,y,z,rz,ry,rx in millimetres and degrees."""
    x = pose(T) * np.array([1, 1, 1, *[180 / np.pi] * 3])
    return ",".join(f"{value:.3f}" for value in x + 0.0)


def _require_sight(workpiece: Jig, touches: Touches, touched: Contacts, at: Placement) -> None:
    """Raise InputError where the touches leave a freedom of the workpiece open."""
    point = workpiece.corners
    centre = (point.min(axis=0) + point.max(axis=0)) / 2
    rim = float(np.linalg.norm(point - centre, axis=1).max())
    dark = unseen(touched, Placement(at.R[0], at.p[0]), centre, rim)
    if dark:
        few = f"{len(touches)} touches cannot fix 6 freedoms, " if len(touches) < FREEDOMS else ""
        raise InputError(f"{few}the touches do not see {'; '.join(dark)}; add touches that do")


def _beyond(workpiece: Jig, touches: Touches, touched: Contacts, at: Placement) -> Float[np.ndarray, "poses touches"]:
    """How far contacts lie beyond the edges of their faces [mm]; 0 on the face, and where no face is named."""
    y = (touched.tip - at.p[:, None, :]) @ at.R
    out = np.zeros(y.shape[:2])
    for i, name in enumerate(touches.face):
        if name in workpiece.by_name:
            face = workpiece.by_name[name]
            place = face.fractions(y[:, i]) * face.size
            out[:, i] = np.linalg.norm(np.maximum(np.maximum(-place, place - face.size), 0.0), axis=1)
    return out


def _location(
    workpiece: Jig, touches: Touches, touched: Contacts, S: Float[np.ndarray, "touches touches"], at: Placement
) -> Location:
    """What was found, and how far to trust it."""
    r, J = (part[0] for part in at.residual(touched))
    W = np.linalg.inv(np.linalg.cholesky(S))
    C = np.linalg.inv((W @ J).T @ (W @ J))
    chi2, degrees = float(((W @ r) ** 2).sum()), len(r) - FREEDOMS
    chance = _chance(chi2, degrees)
    notes, beyond = [], _beyond(workpiece, touches, touched, at)[0]
    if degrees == 0:
        notes.append("six touches fix the pose and leave nothing to check it by: one more would show a wrong one")
    notes += [
        f"touch {touches.ids[i]} lies {beyond[i]:.0f} mm beyond the edge of '{touches.face[i]}': is the face right?"
        for i in np.flatnonzero(beyond > 3 * BESIDE)
    ]
    deviation = np.sqrt(np.diag(S))
    return Location(
        workpiece,
        _matrix(at),
        C,
        dict(zip(touches.ids, r.tolist(), strict=True)),
        dict(zip(touches.ids, deviation.tolist(), strict=True)),
        chi2,
        chance,
        tuple(notes),
    )


def _chance(chi2: float, degrees: int) -> float:
    """Probability of a larger chi-square (normal approximation of its cube root: Wilson and Hilferty 1931)."""
    if degrees < 1:
        return 1.0
    normal = ((chi2 / degrees) ** (1 / 3) - (1 - 2 / (9 * degrees))) / np.sqrt(2 / (9 * degrees))
    return 1 - NormalDist().cdf(normal)
