"""What touches tell about a robot: rows of the Jacobian in a whitened identifiable basis, and what they add up to."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.identifiability import Identifiability, structure
from identify.model.io.calibration_file import Calibration
from identify.model.measurement import MeasurementModel, Rows, touch_conditions
from identify.uncertainty.promise import TipErrors

BUILT = 2  # seed of the signs of what is off
LOOSE = 1e-12  # precision of what nothing is known of


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What is known of a robot before the touches that are being planned.

    The basis is whitened: coordinate k of the kept parameters is measured in units of its prior standard deviation.
    """

    cell: Cell
    theta: Float[np.ndarray, " parameters"]  # [mm, rad], where rows are taken
    names: tuple[str, ...]  # of the kept parameters
    precision: Float[
        np.ndarray, "kept kept"
    ]  # what the estimator assumes before the first touch, in the whitened basis
    spread: Float[np.ndarray, "kept kept"]  # covariance of what the kept parameters have to explain, whitened
    deviation: Float[np.ndarray, "parameters parameters"]  # covariance of all parameters [mm, rad]
    built: Float[np.ndarray, " parameters"] | None = None  # [mm, rad], a robot as it may be built: rows are taken there

    @property
    def typical(self) -> Float[np.ndarray, " parameters"]:
        """The robot whose touches are weighed [mm, rad]."""
        return self.theta if self.built is None else self.built

    @cached_property
    def kept(self) -> list[int]:
        """Places of the kept parameters among all."""
        return [self.cell.robot.parameters.index(name) for name in self.names]

    @cached_property
    def scale(self) -> Float[np.ndarray, " kept"]:
        """One unit of each coordinate [mm] or [rad]."""
        return self.cell.scale[self.kept]

    @cached_property
    def model(self) -> MeasurementModel:
        """The equation of a touch."""
        return MeasurementModel(self.cell.robot)

    def rows(
        self,
        q: Float[np.ndarray, "touches joints"],
        normal: Float[np.ndarray, "touches 3"],
        sigma: Float[np.ndarray, " touches"],
        theta: Float[np.ndarray, " parameters"] | None = None,
        approach: Float[np.ndarray, "touches joints"] | None = None,
    ) -> Float[np.ndarray, "touches kept"]:
        """Gradients of touches in units of sigma a prior standard deviation; their products add up to information.

        Joint errors may depend on the side from which a joint comes, so on the `approach`.
        """
        m = len(q)
        radius = np.full(m, self.cell.wire.flat)
        made = touch_conditions(q, approach) if self.model.conditional else None
        touches = Rows(q, normal, np.zeros(m), radius, sigma, (), np.arange(m), made)
        J = self.model.linearize(self.typical if theta is None else theta, touches)[1]
        return J[:, self.kept] * self.scale / sigma[:, None]

    def tip_rows(
        self, q: Float[np.ndarray, "poses joints"], theta: Float[np.ndarray, " parameters"] | None = None
    ) -> Float[np.ndarray, "poses 3 kept"]:
        """How the tip moves with the whitened parameters [mm]."""
        J = self.cell.kinematics.tip_jacobian(q, self.typical if theta is None else theta)[1]
        return J[:, :, self.kept] * self.scale

    def covariance(self, rows: Float[np.ndarray, "touches kept"]) -> Float[np.ndarray, "kept kept"]:
        """Covariance of the whitened parameters after touches, as the estimator (MAP) sees it."""
        return np.linalg.inv(self.precision + rows.T @ rows)

    def error(
        self, rows: Float[np.ndarray, "touches kept"], faces: Sequence[str], times: float = 1.0
    ) -> Float[np.ndarray, "kept kept"]:
        """Covariance of the estimator's error after touches on named faces, each made so many `times`.

        The estimator takes every touch for independent and the eliminated parameters for nominal. But all touches on a
        face share what the face is off by, and what eliminated parameters are off by falls to those that carry them.
        With infinitely many only the faces remain.
        """
        tolerance, sigma = face_tolerance(self.cell, faces), touch_sigma(self.cell, faces)
        belongs = np.unique(faces)[:, None] == np.asarray(faces, dtype=np.str_) if len(rows) else np.zeros((0, 0))
        once = max(1 / times, 1e-9)  # of the precision, beside that of the touches
        L = np.linalg.cholesky(self.precision + LOOSE * np.eye(len(self.precision)))
        unseen = np.zeros((len(L), len(L)))  # so that there is a direction for every parameter
        U, s, Vt = np.linalg.svd(np.vstack([np.linalg.solve(L, rows.T).T, unseen]), full_matrices=False)
        gain = np.linalg.solve(L.T, (Vt.T * (s / (once + s**2))) @ U[: len(rows)].T)  # errors of touches, in sigma
        held = np.linalg.solve(L.T, (Vt.T * (once / (once + s**2))) @ Vt @ L.T)  # errors that the prior does not see
        own = gain * np.sqrt(once) * (self.cell.touch.sigma / sigma)
        shared = (gain * (tolerance / sigma)) @ belongs.T
        return own @ own.T + shared @ shared.T + held @ self.spread @ held.T


def drawn(known: Knowledge, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count parameters"]:
    """Parameters of robots that what is known leaves possible [mm, rad]."""
    value, vector = np.linalg.eigh(known.deviation)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    return known.theta + rng.standard_normal((count, len(root))) @ root.T


def nominal_knowledge(cell: Cell) -> Knowledge:
    """What drawing and tolerances tell; raises InputError where base or tool stand nowhere yet."""
    for name, pose in (("base", cell.base), ("tool", cell.tool)):
        if pose is None:
            raise InputError(
                f"{name}: fit leaves open where the {name} stands, and touches cannot be planned for a robot that may "
                "be anywhere; write its nominal pose in cell.yaml, or give an earlier calibration with --after"
            )
    found = structure(cell)
    names = tuple(cell.robot.parameters[i] for i in found.kept)
    known = (cell.scale / cell.prior)[list(found.kept)]
    return Knowledge(cell, cell.theta, names, np.diag(known**2), _spread(_handed(cell, found)), np.diag(cell.spread**2))


def built_knowledge(cell: Cell) -> Knowledge:
    """What drawing and tolerances tell, seen from a robot as it may be built: each parameter off by its tolerance.

    Axes that are parallel on the drawing are not on such a robot, so that touches have more parameters to tell apart:
    a plan for the drawing alone leaves these to their tolerances, and misses the weld zone by a third more.
    """
    nominal = nominal_knowledge(cell)
    lower, upper = np.array([cell.bounds.get(name, (-np.inf, np.inf)) for name in cell.robot.parameters]).T
    sign = np.sign(np.random.default_rng(BUILT).standard_normal(len(nominal.theta)))
    built = np.clip(nominal.theta + sign * np.sqrt(np.diag(nominal.deviation)), lower, upper)
    found = structure(cell, built)
    names, handed = tuple(cell.robot.parameters[i] for i in found.kept), _handed(cell, found)
    return replace(nominal, names=names, precision=_precision(handed), spread=_spread(handed), built=built)


def prior_knowledge(cell: Cell, calibration: Calibration) -> Knowledge:
    """What drawing and tolerances told before a calibration, in its parameters and seen from what it has found."""
    nominal = nominal_knowledge(cell)
    if calibration.combinations:
        return replace(nominal, theta=calibration.theta)
    names, kept = calibration.estimated, np.eye(len(calibration.estimated))
    return replace(nominal, theta=calibration.theta, names=names, precision=kept, spread=kept)


def _handed(cell: Cell, found: Identifiability) -> Float[np.ndarray, "kept eliminated"]:
    """What eliminated parameters hand over to the kept ones that carry them, whitened."""
    place = {found.names[i]: row for row, i in enumerate(found.kept)}
    scale = dict(zip(found.names, cell.scale, strict=True))
    T = np.zeros((len(place), len(found.combinations)))
    for column, (name, terms) in enumerate(found.combinations.items()):
        for kept, coefficient in terms.items():
            T[place[kept], column] = coefficient * scale[name] / scale[kept]
    return T


def _spread(T: Float[np.ndarray, "kept eliminated"]) -> Float[np.ndarray, "kept kept"]:
    """Covariance of the kept parameters together with what is handed over to them."""
    return np.eye(len(T)) + T @ T.T


def _precision(T: Float[np.ndarray, "kept eliminated"]) -> Float[np.ndarray, "kept kept"]:
    """Its inverse, exact even where nearly parallel axes hand over a million times what was known."""
    U, s, _ = np.linalg.svd(T, full_matrices=False)
    share = s / np.sqrt(1 + s**2)
    return np.eye(len(T)) - (U * share) @ (U * share).T


def knowledge_after(cell: Cell, calibration: Calibration) -> Knowledge:
    """What an earlier calibration tells: its parameters, and its covariance turned into information."""
    names = cell.robot.parameters
    if calibration.cell.robot.parameters != names:
        raise InputError(
            f"the calibration is of robot '{calibration.cell.robot.name}' with other parameters than "
            f"'{cell.robot.name}'; plan with the cell it was made for"
        )
    scale = cell.scale[calibration.index]
    precision = np.linalg.inv(calibration.covariance / np.outer(scale, scale))
    precision = (precision + precision.T) / 2
    deviation = np.zeros((len(names), len(names)))
    deviation[np.ix_(calibration.index, calibration.index)] = calibration.covariance
    return Knowledge(cell, calibration.theta, calibration.estimated, precision, np.linalg.inv(precision), deviation)


def touch_sigma(cell: Cell, faces: Sequence[str]) -> Float[np.ndarray, " touches"]:
    """Standard deviations of touches on named faces [mm]: repeatability and machining tolerance in quadrature."""
    return np.hypot(cell.touch.sigma, face_tolerance(cell, faces))


def face_tolerance(cell: Cell, faces: Sequence[str]) -> Float[np.ndarray, " touches"]:
    """Standard deviations of where named faces stand [mm]."""
    return np.array([cell.the_jig.by_name[name].tolerance for name in faces])


def tip_errors(tip: Float[np.ndarray, "poses 3 kept"], covariance: Float[np.ndarray, "kept kept"]) -> TipErrors:
    """Tip errors by a covariance, which may be singular."""
    value, vector = np.linalg.eigh(covariance)
    return TipErrors(tip @ (vector * np.sqrt(np.maximum(value, 0.0))))
