"""What a calibration says of all unknowns, and what it promises in the weld zone."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.calibration_file import Calibration
from identify.model.zone import zone_poses
from identify.uncertainty.information import Information
from identify.uncertainty.promise import Promise, TipErrors, promise
from identify.uncertainty.unknowns import Unknowns


def posterior(calibration: Calibration, cell: Cell | None = None) -> Information:
    """What a calibration says, of its own cell or of another one with the same robot.

    The priors hold for faces that it does not know. Parameters that it left at their drawing stay there.
    """
    cell = calibration.cell if cell is None else cell
    if calibration.cell.robot.parameters != cell.robot.parameters:
        raise InputError(
            f"the calibration is of robot '{calibration.cell.robot.name}' with other parameters than "
            f"'{cell.robot.name}'; plan with the cell it was made for"
        )
    everything = Unknowns.of(cell)
    unknowns = replace(everything, parameters=np.array(calibration.index))
    return Information.of_covariance(unknowns, calibration.theta, calibration.estimated, calibration.covariance)


def tip_errors(calibration: Calibration, q: Float[np.ndarray, "poses joints"]) -> TipErrors:
    """Errors of the tip at poses, of robots like this one."""
    known = posterior(calibration)
    return TipErrors(known.root(known.unknowns.tip_rows(q, known.theta)))


def zone_promise(calibration: Calibration) -> Promise:
    """The tip error that a calibration promises in the weld zone; raises InputError if the robot reaches none of it."""
    return promise(tip_errors(calibration, zone_poses(calibration.cell, calibration.theta)))
