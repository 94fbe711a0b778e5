"""What every format gives: texts, and how far what was written is from what was identified."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.compensation.compensate import tip_transform
from identify.compensation.fitting import sample
from identify.model.io.calibration_file import Calibration

Forward = Callable[[Float[np.ndarray, "poses joints"]], Float[np.ndarray, "poses 4 4"]]


@dataclass(frozen=True)
class Original:
    """The URDF that a robot came from, and the two ends of its chain."""

    path: Path
    base: str
    flange: str


@dataclass(frozen=True)
class Deviation:
    """How far tips are apart, over poses."""

    mean_mm: float
    max_mm: float
    max_deg: float


@dataclass(frozen=True)
class Exported:
    """A calibration in another format."""

    files: Mapping[str, str]  # text by what is put behind the stem of the file's name
    deviation: Deviation  # of what was written and read again from what was identified
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Format:
    """A format: how it is written, and how it is read again; a row of FORMATS."""

    suffix: str
    write: Callable[[Calibration, Original | None], tuple[Mapping[str, str], tuple[str, ...]]]
    read: Callable[[Mapping[str, str], Calibration], Forward]  # jig_T_tip of what was written
    beyond: bool = False  # whether it takes robots with joint errors, not only geometry


def deviation(calibration: Calibration, forward: Forward) -> Deviation:
    """How far tips are from where the identified robot has them, over poses where accuracy counts."""
    q = sample(calibration)
    true, exported = tip_transform(calibration, q, calibration.theta), forward(q)
    way = np.linalg.norm(true[:, :3, 3] - exported[:, :3, 3], axis=1)
    R = np.swapaxes(true[:, :3, :3], 1, 2) @ exported[:, :3, :3]
    v = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    turn = np.arctan2(np.linalg.norm(v, axis=1), (np.trace(R, axis1=1, axis2=2) - 1) / 2)
    return Deviation(float(way.mean()), float(way.max()), float(np.degrees(turn.max())))
