"""What more touches like those that were made would promise, and how many a target takes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from identify.model.io.calibration_file import Calibration
from identify.model.measurement import rows
from identify.model.touch import Touches
from identify.model.zone import zone_poses
from identify.uncertainty.information import Information
from identify.uncertainty.posterior import posterior
from identify.uncertainty.promise import TipErrors, promise
from identify.uncertainty.weak_directions import limiting

OFTEN = (1.0, 2.0, 4.0, 8.0, 16.0, 64.0, 256.0, 4096.0)  # times that the touches may be made
HALVINGS = 6  # of the step between two of them


@dataclass(frozen=True, eq=False)
class MoreTouches:
    """A calibration, and the touches that it rests on made more often."""

    calibration: Calibration
    touches: Touches
    now: float  # [mm], promised by the touches as they are

    def promised(self, times: float) -> float:
        """The tip error [mm] promised if each touch was made so many `times`."""
        return self.now * self._stated(times) / self._stated(1.0)

    @property
    def floor(self) -> float:
        """What stays however often these touches are made: the faces are where the tolerance of the jig puts them."""
        return self.promised(OFTEN[-1])

    def times(self, target: float) -> float:
        """How many times the touches so far it takes for a target [mm]; infinite below the floor."""
        high = next((times for times in OFTEN if self.promised(times) <= target), np.inf)
        if not np.isfinite(high):
            return np.inf
        low = max((times for times in OFTEN if times < high), default=0.0)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if self.promised(middle) > target else (low, middle)
        return float(high)

    @property
    def limit(self) -> str:
        """What most of the remaining tip error comes from, and the face that would show it."""
        zone = zone_poses(self.calibration.cell, self.calibration.theta)
        return limiting(self._prior.updated(self._rows), zone)

    def _stated(self, times: float) -> float:
        """By priors and scatter as they are stated."""
        after = self._prior.updated(np.sqrt(times) * self._rows)
        return promise(TipErrors(after.root(self._tip))).p95_mm

    @cached_property
    def _prior(self) -> Information:
        unknowns = posterior(self.calibration).unknowns
        return Information.prior(unknowns).at(self.calibration.theta)

    @cached_property
    def _rows(self) -> Float[np.ndarray, "touches unknowns"]:
        cell = self.calibration.cell
        equations = rows(cell.wire, [self.touches], cell.robot)
        return self._prior.unknowns.rows(equations, self.calibration.theta)

    @cached_property
    def _tip(self) -> Float[np.ndarray, "poses 3 unknowns"]:
        theta = self.calibration.theta
        return self._prior.unknowns.tip_rows(zone_poses(self.calibration.cell, theta), theta)
