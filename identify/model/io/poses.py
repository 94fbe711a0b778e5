"""poses.csv: tip poses that are wanted, in a frame that the reader is told."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.model.files import Sheet, read_sheet
from identify.model.io.entries import POSE_KEYS, POSE_UNIT
from identify.model.touch import Table

RIGHT = (np.pi / 2, np.pi)  # what a right angle and a half turn look like in radians
SHORT = 5.0  # [mm], below which poses that differ were meant in metres


@dataclass(frozen=True, eq=False)
class Poses(Table):
    """Wanted poses of the tip."""

    ids: tuple[str, ...]
    pose: Float[np.ndarray, "poses 6"]  # x, y, z [mm], rz, ry, rx [rad]


def read_poses(path: Path, *, trust_units: bool = False) -> Poses:
    """Read poses.csv; raises InputError with every mistake."""
    sheet = read_sheet(path, ["id", *POSE_KEYS], [])
    ids = sheet.ids()
    values = np.column_stack([sheet.numbers(name) for name in POSE_KEYS])
    if not trust_units:
        _units(sheet, values)
    sheet.stop()
    return Poses(tuple(ids), values * POSE_UNIT)


def _units(sheet: Sheet, values: Float[np.ndarray, "poses 6"]) -> None:
    """Note numbers that look like metres or radians."""
    for row, column in np.argwhere(np.isclose(np.abs(values[:, 3:, None]), RIGHT, rtol=0, atol=5e-4).any(axis=2)):
        name, value = POSE_KEYS[3 + column], values[row, 3 + column]
        sheet.wrong(int(row), f"{name} is {value:g}: radians? write degrees, or say --trust-units")
    if len(values) and 0 < np.nanmax(np.abs(values[:, :3]), initial=0.0) < SHORT:
        sheet.at(0, f"no pose lies {SHORT:g} mm from the origin: metres? write millimetres, or say --trust-units")
