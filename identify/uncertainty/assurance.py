"""What touches that were made promise of the tip in the weld zone, and what more of them could at best."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.io.calibration_file import Calibration
from identify.model.touch import Touches
from identify.model.zone import zone_poses
from identify.uncertainty.information import Knowledge, knowledge_after, prior_knowledge

ROBOTS = 400  # drawn from what is known
OFTEN = (1.0, 2.0, 4.0, 8.0, 16.0, 64.0, 256.0)  # times that the touches made so far may be made
SHARE = 95.0  # percent of the poses of a robot, and of the robots


@dataclass(frozen=True, eq=False)
class Assurance:
    """The tip error of a calibrated robot, from the touches that it rests on and the priors."""

    known: Knowledge  # before the touches, at the parameters found
    rows: Float[np.ndarray, "touches kept"]
    faces: tuple[str, ...]
    tip: Float[np.ndarray, "poses 3 kept"]
    widened: float  # by the scatter of the residuals, where chance does not explain it

    def promised(self, times: float = 1.0) -> float:
        """Tip error [mm] 95 of 100 such robots stay below at 95 % of the poses; each touch made so many `times`."""
        return self.widened * assured(self.tip, self.known.error(self.rows, self.faces, times))

    @property
    def floor(self) -> float:
        """What stays however often these touches are made: the faces are where the tolerance of the jig puts them.

        The estimator takes touches for independent, so without end it would rather bend the robot than doubt a face:
        the least that any number of them promises is meant.
        """
        return min(self.promised(times) for times in OFTEN)

    def missing(self, target: float) -> float:
        """How many times the touches made so far it takes for a target [mm]; infinite below the floor."""
        high = next((times for times in OFTEN if self.promised(times) <= target), np.inf)
        if not np.isfinite(high):
            return np.inf
        low = max((times for times in OFTEN if times < high), default=0.0)
        for _ in range(6):
            middle = (low + high) / 2
            low, high = (middle, high) if self.promised(middle) > target else (low, middle)
        return float(high)


def assured(tip: Float[np.ndarray, "poses 3 kept"], covariance: Float[np.ndarray, "kept kept"]) -> float:
    """Tip error [mm] at 95 % of the poses that 95 of 100 robots, drawn with a covariance, stay below."""
    value, vector = np.linalg.eigh(covariance)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    draws = root @ np.random.default_rng(0).standard_normal((len(root), ROBOTS))
    error = np.linalg.norm(np.einsum("pik,kd->pdi", tip, draws, optimize=True), axis=2)
    return float(np.percentile(np.percentile(error, SHARE, axis=0), SHARE))


def assurance(cell: Cell, calibration: Calibration, touches: Touches) -> Assurance:
    """The assurance of a calibration that was made from some touches on named faces."""
    known = prior_knowledge(cell, calibration)
    if known.names == calibration.estimated:
        rows = known.rows(touches.q, touches.normal, touches.sigma, approach=touches.approach)
    else:  # joints that never moved: what is left of the parameters has no prior of its own here
        known, rows = knowledge_after(cell, calibration), np.zeros((0, len(calibration.estimated)))
    tip = known.tip_rows(zone_poses(cell, calibration.theta))
    widened = calibration.scatter if calibration.scatter_significant else 1.0
    faces = touches.face if len(rows) else ()
    return Assurance(known, rows, faces, tip, max(widened, 1.0))


def tip_deviation(
    cell: Cell, theta: Float[np.ndarray, " parameters"], covariance: Float[np.ndarray, "parameters parameters"]
) -> float:
    """Standard deviation of the tip in its worst direction [mm], at all but a tenth of the poses of the zone."""
    J = cell.kinematics.tip_jacobian(zone_poses(cell, theta, 100), theta)[1]
    worst = np.linalg.eigvalsh(J @ covariance @ J.transpose(0, 2, 1))[:, -1]
    return float(np.percentile(np.sqrt(np.maximum(worst, 0.0)), 90))
