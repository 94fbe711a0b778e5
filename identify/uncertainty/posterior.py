"""What a calibration says of all unknowns, and what it promises in the weld zone."""

from collections.abc import Iterator
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

    The priors hold for faces that it does not know. Parameters that it left at their drawing stay there; blocks of
    measurements, further placements, tools and points belong to what was measured, and are marginalized.
    """
    cell = calibration.cell if cell is None else cell
    if calibration.cell.robot.parameters != cell.robot.parameters:
        raise InputError(
            f"the calibration is of robot '{calibration.cell.robot.name}' with other parameters than "
            f"'{cell.robot.name}'; plan with the cell it was made for"
        )
    unknowns = replace(Unknowns.of(cell), parameters=np.array(calibration.index, dtype=int), named=())
    shared_names = {*calibration.estimated, *_same_faces(calibration.cell, cell)} & set(unknowns.names)
    index = [i for i, name in enumerate(calibration.names) if name in shared_names]
    names = [calibration.names[i] for i in index]
    C = calibration.joint_covariance[np.ix_(index, index)]
    return Information.of_covariance(unknowns, calibration.theta, names, C)


def _same_faces(a: Cell, b: Cell) -> Iterator[str]:
    """Names of the unknowns of faces that stand in two cells alike."""
    for face in () if a.jig is None or b.jig is None else a.jig.faces:
        other = b.the_jig.by_name.get(face.name)
        if other is not None and np.allclose([*face.normal, face.offset], [*other.normal, other.offset]):
            yield from (f"face.{face.name}{tilt}" for tilt in ("", ".tilt_u", ".tilt_v"))


def tip_errors(calibration: Calibration, q: Float[np.ndarray, "poses joints"]) -> TipErrors:
    """Errors of the tip at poses, of robots like this one.

    What measurements scatter beyond their stated sigma may be the robot's, so it is part of the error.
    """
    prior = posterior(calibration)
    excess = calibration.cell.touch.sigma * np.sqrt(max(calibration.noise**2 - 1.0, 0.0))
    own = np.broadcast_to(excess * np.eye(3), (len(q), 3, 3))
    return TipErrors(np.concatenate([prior.root(prior.unknowns.tip_rows(q, prior.theta)), own], axis=2))


def zone_promise(calibration: Calibration) -> Promise:
    """The tip error that a calibration promises in the weld zone, the one of its file if that holds one.

    Raises InputError if the robot reaches no pose of the zone.
    """
    if calibration.promise is not None:
        return Promise(**calibration.promise)
    return promise(tip_errors(calibration, zone_poses(calibration.cell, calibration.theta)))
