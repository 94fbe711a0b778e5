"""Errors where the fit has not looked: the only ones that may be called an accuracy."""

from dataclasses import dataclass

import numpy as np

from identify.model.files import InputError
from identify.model.io.calibration_file import Calibration, Errors, fingerprints, summarize
from identify.model.measurement import Measured, Rows, measurement_model, rows


@dataclass(frozen=True)
class Verification:
    """Errors at touches or positions that a calibration has not seen, and what it had promised there."""

    nominal: Errors
    identified: Errors
    promised_p95_mm: float  # 95th percentile of what parameters, touches and jig scatter together


def verify(calibration: Calibration, *measured: Measured) -> Verification:
    """Errors of the nominal and of the identified robot; raises InputError where a measurement was used in the fit."""
    found = rows(calibration.cell.wire, measured, calibration.cell.robot.temperature)
    if not len(found):
        raise InputError("there is nothing to verify with: no touch of status hit, no position")
    require_unseen(calibration, found, "errors there are no accuracy; verify with others")
    model = measurement_model(calibration.cell.robot)
    before = found.distances(model.residual(calibration.start, found))
    r, J = model.linearize(calibration.theta, found)
    J = J[:, calibration.index]
    widened = max(1.0, calibration.scatter if calibration.scatter_significant else 1.0)
    variance = ((J @ calibration.covariance) * J).sum(axis=1) + (found.sigma * widened) ** 2
    return Verification(summarize(before), summarize(found.distances(r)), _p95(found.distances(np.sqrt(variance))))


def require_unseen(calibration: Calibration, found: Rows, cure: str) -> None:
    """Raise InputError where measurements were used in the fit."""
    prints = fingerprints(found.q, found.offset[:, None])
    seen = [found.ids[found.owner[i]] for i, name in enumerate(prints) if name in calibration.fingerprints]
    if seen:
        raise InputError(
            f"{len(set(seen))} of {len(found.ids)} measurements were used in the fit ({seen[0]}, ...): {cure}"
        )


def _p95(deviation: np.ndarray) -> float:
    """95th percentile of normal errors with these standard deviations, mixed; a fixed draw stands for the integral."""
    draws = np.random.default_rng(0).standard_normal((2000, 1))
    return float(np.percentile(np.abs(draws * deviation), 95))
