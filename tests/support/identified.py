"""Calibrations made by hand, for what comes after the identification."""

import numpy as np

from identify.model.cell import Cell
from identify.model.frames import pose
from identify.model.io.calibration_file import Calibration, Errors

Q = np.array([[0.1, 0.2, -0.3, 0.4, 0.9, 0.3], [0.2, 0.3, -0.4, 0.1, 1.0, -0.3], [0.1, 0.2, -0.3, 0.4, 0.8, 0.3]])
JOB = """/JOB
//NAME SEAM
//POS
///NPOS 2,0,0,0,0,0
///TOOL 1
///POSTYPE ANGLE
///ANGLE
C00000=5.0000,10.0000,-15.0000,20.0000,50.0000,-0.2500
///POSTYPE PULSE
///PULSE
C00001=1,2,3,4,5,6
//INST
NOP
MOVL C00000 V=10.0
END
"""


def identified(cell: Cell, theta: np.ndarray, **changes) -> Calibration:
    """A calibration that found exactly these parameters, as good as certain."""
    none = Errors(0, 0.0, 0.0, 0.0, 0.0)
    return Calibration(
        **{
            "cell": cell,
            "theta": theta,
            "start": cell.theta,
            "estimated": ("base.x",),
            "combinations": {},
            "covariance": np.array([[1e-8]]),
            "scatter": 1.0,
            "scatter_significant": False,
            "weak": (),
            "outliers": {},
            "fit": none,
            "held_out": None,
            "residuals": {},
            "fingerprints": frozenset(),
            "iterations": 0,
            "solve_s": 0.0,
            **changes,
        }
    )


def poses_at(cell: Cell, q: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
    """Tip poses x, y, z [mm], rz, ry, rx [rad] in the jig frame; of the nominal robot where none is named."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :3, 3], T[:, :3, :3] = cell.kinematics.tip(q, cell.theta if theta is None else theta)
    return pose(T)
