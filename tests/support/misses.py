"""Robots drawn from the tolerances of a cell that make a plan along its search lines: what they miss and learn."""

from dataclasses import dataclass

import numpy as np

from identify.model.zone import zone_poses
from studies.many import calibrate_many, draw_many, errors_in_zone, touch_many


@dataclass(frozen=True)
class Made:
    """Tip errors in the zone after calibration, a number a robot, and the touches that met their faces."""

    rms: np.ndarray  # [mm]
    p95: np.ndarray  # [mm]
    hit: np.ndarray  # robots x touches

    def __str__(self):
        return (
            f"RMS {np.median(self.rms):.3f} median, {np.percentile(self.rms, 90):.3f} mm 90th percentile, "
            f"{100 * (1 - self.hit.mean()):.1f} % missed"
        )


def made(cell, plan, robots, seed=77):
    """What robots with faces off by their tolerances learn; a touch that misses is lost."""
    rng = np.random.default_rng(seed)
    theta = draw_many(cell, robots, rng)
    names = [face.name for face in cell.the_jig.faces]
    proud = rng.standard_normal((robots, len(names))) * [face.tolerance for face in cell.the_jig.faces]
    touches = touch_many(cell, theta, plan, rng, proud=proud[:, [names.index(name) for name in plan.face]])
    known = calibrate_many(cell, touches, eliminate=False)
    zone = zone_poses(cell, poses=200, rng=np.random.default_rng(2024))
    error = errors_in_zone(cell, theta, known.theta, zone)
    return Made(np.sqrt((error**2).mean(axis=1)), np.percentile(error, 95, axis=1), touches.hit)
