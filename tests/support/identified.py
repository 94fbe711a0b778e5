"""Calibrations made by hand, for what comes after the identification."""

import numpy as np

from identify.model.cell import Cell
from identify.model.frames import pose
from identify.model.io.calibration_file import Calibration, Errors


def identified(cell: Cell, theta: np.ndarray, **changes) -> Calibration:
    """A calibration that found exactly these parameters, as good as certain."""
    none = Errors(0, 0.0, 0.0, 0.0, 0.0)
    return Calibration(**{
        "cell": cell, "theta": theta, "start": cell.theta, "estimated": ("base.x",), "combinations": {},
        "covariance": np.array([[1e-8]]), "scatter": 1.0, "scatter_significant": False, "weak": (), "outliers": {},
        "fit": none, "held_out": None, "residuals": {}, "fingerprints": frozenset(), "iterations": 0, "solve_s": 0.0,
        **changes,
    })  # fmt: skip


def poses_at(cell: Cell, q: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
    """Tip poses x, y, z [mm], rz, ry, rx [rad] in the jig frame; of the nominal robot where none is named."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :3, 3], T[:, :3, :3] = cell.kinematics.tip(q, cell.theta if theta is None else theta)
    return pose(T)
