"""A kind of measurement of one's own: a height gauge, which reads z of the tip in the jig frame."""

from dataclasses import dataclass
from typing import cast

import numpy as np

import identify
import oed
import probe
from identify.model.measurement import MEASUREMENTS, Kind, Measurements, Rows
from identify.model.touch import Table


@dataclass(frozen=True, eq=False)
class Heights(Table):
    """Heights z of the tip [mm] at joint values q [rad], to 0.02 mm."""

    ids: tuple[str, ...]
    q: np.ndarray
    z: np.ndarray
    placement = tool = None


def height_rows(wire: object, heights: Heights, places: object) -> Rows:
    """Equation z . tip = height, one row a reading."""
    m = len(heights)
    return Rows(heights.q, np.eye(3)[[2] * m], heights.z, np.zeros(m), np.full(m, 0.02), heights.ids, np.arange(m))


MEASUREMENTS["height"] = Kind(Heights, height_rows, ("z_mm",), "a height gauge")
cell, rng = identify.read_cell(identify.library("cells")["arc-welder"]), np.random.default_rng(3)
truth = probe.draw_truth(cell, rng, scale=0.1)
touches = probe.touch_batch(cell, truth, oed.plan(cell, 40, rng=rng, count=1500).plan, rng)
z = cell.kinematics.tip(touches.q, truth.theta)[0][:, 2] + 0.02 * rng.standard_normal(40)
heights = cast(Measurements, Heights(tuple(f"h{i}" for i in range(40)), touches.q, z))
for measured in ([touches], [touches, heights]):
    calibration = identify.calibrate(cell, *measured, errors="cell")
    print(f"{len(calibration.residuals)} measurements, lean of the base to {np.degrees(calibration.sigma[5]):.4f} deg")
