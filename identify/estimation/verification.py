"""Errors where the fit has not looked: the only ones that may be called an accuracy."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identify.model.calibration import Calibration, Errors, coordinates, fingerprints, summarize
from identify.model.files import InputError
from identify.model.measurement import Measurements, Rows, measurement_model, rows
from identify.model.zone import zone_poses
from identify.uncertainty.information import Information
from identify.uncertainty.promise import ROBOTS, SHARE
from identify.uncertainty.unknowns import Unknowns

LEAST = 0.005  # share of the poses that is worth a word
SLACK = 0.02  # of the range of the data, beyond which a pose lies where there was none


@dataclass(frozen=True)
class Verification:
    """Errors at touches or positions that a calibration has not seen, and what it had promised there."""

    nominal: Errors
    """Of the robot as it was before the fit [mm]."""
    identified: Errors
    """Of the calibrated robot [mm]."""
    promised_p95_mm: float
    """95 of 100 robots stay below it at 95 % of these poses, sensor and jig included."""

    beyond: tuple[str, ...] = ()
    """Where poses lie beyond the data of the fit, most of them first."""

    @property
    def kept(self) -> bool:
        """Whether the errors are as small as was promised."""
        return self.identified.p95_mm <= self.promised_p95_mm


def verify(calibration: Calibration, *tables: Measurements) -> Verification:
    """Errors of the nominal and of the identified robot; raises InputError if a measurement was used in the fit."""
    cell, tables = calibration.cell, tuple(table.measured() for table in tables)
    for table in tables:
        cell.robot.require_radians(table.q)
    equations = rows(cell.wire, tables, cell.robot, cell.places)
    if not len(equations):
        raise InputError("there is nothing to verify with: no touch of status hit, no position")
    require_unseen(calibration, equations, "errors there are no accuracy; verify with others")
    before = measurement_model(calibration.cell.robot).residual(calibration.start, equations)
    r, root = predicted(calibration, equations)
    promised = _promised(root, equations.sigma * calibration.noise, equations)
    nominal, identified = summarize(equations.distances(before)), summarize(equations.distances(r))
    return Verification(nominal, identified, promised, beyond(calibration, equations.q))


def beyond(calibration: Calibration, q: Float[np.ndarray, "poses joints"]) -> tuple[str, ...]:
    """Joint and tip coordinates in which poses lie beyond the data of a calibration, with their share of the poses."""
    places = list[tuple[float, str]]()
    for name, value in coordinates(calibration.cell, calibration.theta, q).items():
        low, high = calibration.spans.get(name, (-np.inf, np.inf))
        slack = SLACK * (high - low) if np.isfinite(high - low) else 0.0
        axis, unit = name.rsplit(" ", 1)
        for side, out, end in (("below", value < low - slack, low), ("above", value > high + slack, high)):
            if out.mean() >= LEAST:
                places.append((float(out.mean()), f"{axis} {side} {end:.0f} {unit}: {100 * out.mean():.0f} %"))
    return tuple(text for _, text in sorted(places, reverse=True))


def beyond_in_zone(calibration: Calibration) -> tuple[str, ...]:
    """Where in the weld zone the fit had no data; nothing for a cell without zone and jig."""
    if calibration.cell.zone is None and calibration.cell.jig is None:
        return ()
    return beyond(calibration, zone_poses(calibration.cell, calibration.theta))


def predicted(
    calibration: Calibration, equations: Rows
) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, "rows unknowns"]]:
    """Residuals [mm] by the identified robot and jig, and B with B B' their covariance, but for the sensor's scatter.

    Faces that were not estimated stand on the drawing within their tolerance.
    """
    values = dict(zip(calibration.names, calibration.values, strict=True))
    every = Unknowns.of(calibration.cell)
    unknowns = replace(
        every,
        parameters=np.array(calibration.index, dtype=int),
        named=tuple(named for named in every.named if named.names[0] in values),
    )
    names = [name for name in calibration.names if name in set(unknowns.names)]
    place = [calibration.names.index(name) for name in names]
    information = Information.of_covariance(
        unknowns, calibration.theta, names, calibration.joint_covariance[np.ix_(place, place)]
    )
    there = np.array([values.get(name, origin) for name, origin in zip(unknowns.names, unknowns.origin, strict=True)])
    r, J = unknowns.linearize((there - unknowns.origin) / unknowns.scale, equations, calibration.theta)
    return r, information.root(J)


def require_unseen(calibration: Calibration, equations: Rows, cure: str) -> None:
    """Raise InputError where measurements were used in the fit."""
    prints = fingerprints(equations.q, equations.offset[:, None])
    repeated = [equations.ids[equations.owner[i]] for i, name in enumerate(prints) if name in calibration.fingerprints]
    if repeated:
        raise InputError(
            f"{len(set(repeated))} of {len(equations.ids)} measurements were used in the fit "
            f"({repeated[0]}, ...): {cure}"
        )


def _promised(root: Float[np.ndarray, "rows directions"], sigma: Float[np.ndarray, " rows"], equations: Rows) -> float:
    """Error [mm] that 95 of 100 robots stay below at 95 % of the measurements; fixed draws stand for the integral."""
    rng = np.random.default_rng(0)
    errors = root @ rng.standard_normal((root.shape[1], ROBOTS))
    errors += sigma[:, None] * rng.standard_normal((len(sigma), ROBOTS))
    _, place = np.unique(equations.owner, return_inverse=True)
    square = np.zeros((place.max() + 1, ROBOTS))
    np.add.at(square, place, errors**2)
    return float(np.percentile(np.percentile(np.sqrt(square), SHARE, axis=0), SHARE))
