"""What calibrations find in the residuals of touches."""

from identify.estimation.calibrate import calibrate

SIGMA = 0.05  # [mm]
TOUCHES = 120


def findings(cell, *tables):
    """The findings of a calibration, by kind."""
    return {found.kind: found for found in calibrate(cell, *tables, folds=0, errors="cell").findings}
