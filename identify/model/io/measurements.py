"""Files that hold measurements of any kind: which kind a row is follows from the columns that it fills."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import Sheet, nearest, read_sheet
from identify.model.io.tables import (
    POINT,
    block_of,
    joint_columns,
    joints_of,
    positions_of,
    refuse_plan,
    rows_of,
    sigma_of,
    touch_columns,
    touches_of,
)
from identify.model.measurement import Measurements
from identify.model.touch import Contacts, Distances, Poses, Positions, Touches

ANGLES = ("rz_deg", "ry_deg", "rx_deg")
CONDITIONS = ("sigma_mm", "sigma_deg", "placement", "tool", "payload_kg", "temperature_c", "note")
COLUMNS = {"distance": ("anchor", "distance_mm"), "contact": ("point",), "pose": ANGLES, "position": POINT}
"""Columns by which a row shows its kind; a row that fills none of them is a touch."""


def read_measurements(path: Path | str, cell: Cell, *, trust_units: bool = False) -> tuple[Measurements, ...]:
    """Read touches, positions, poses, distances and contacts, a table each; raises InputError with every mistake.

    Rows may name a further `placement` or `tool` of the cell.
    """
    known = [*touch_columns(cell.robot), *CONDITIONS, *(c for columns in COLUMNS.values() for c in columns)]
    sheet = read_sheet(path, ["id", *joint_columns(cell.robot)], known)
    refuse_plan(sheet)
    sheet.ids()
    _check_payload(sheet, cell)
    kinds = _kinds(sheet)
    tables = [
        READERS[kind](_part(sheet, [k == kind for k in kinds]), cell, trust_units)
        for kind in dict.fromkeys(kinds or ["touch"])
    ]
    sheet.stop()
    return tuple(tables)


def _kinds(sheet: Sheet) -> list[str]:
    """The kind of each row, by the columns that it fills; columns that a kind lacks are mistakes."""
    kinds = []
    filled = {kind: _filled(sheet, columns) for kind, columns in COLUMNS.items()}
    for row in range(len(sheet.lines)):
        here = [kind for kind, column in filled.items() if column[row]]
        if "pose" in here and "position" in here:
            here.remove("position")
        if len(here) > 1:
            sheet.wrong(row, f"the columns of a {here[0]} and of a {here[1]} are filled; keep one measurement a row")
        kinds.append(here[0] if here else "touch")
    for kind in {*kinds} - {"touch"}:
        needed = (*POINT, *ANGLES) if kind == "pose" else COLUMNS[kind]
        for name in (name for name in needed if name not in sheet.columns):
            sheet.at(1, f"column '{name}' of a {kind} is missing")
    return kinds


def _filled(sheet: Sheet, columns: Sequence[str]) -> list[bool]:
    """Whether each row has something in one of some columns."""
    cells = [sheet.columns[name] for name in columns if name in sheet.columns]
    return [any(cell.strip() for cell in row) for row in zip(*cells, strict=True)] or [False] * len(sheet.lines)


def _part(sheet: Sheet, rows: Sequence[bool]) -> Sheet:
    return sheet if all(rows) else rows_of(sheet, np.array(rows))


def _touches(sheet: Sheet, cell: Cell, trust_units: bool) -> Touches:
    part = touches_of(sheet, cell, trust_units)
    return replace(part, placement=_names(sheet, "placement", cell.placements), tool=_names(sheet, "tool", cell.tools))


def _positions(sheet: Sheet, cell: Cell, trust_units: bool) -> Positions:
    part = positions_of(sheet, cell, trust_units)
    placement, tool = _names(sheet, "placement", cell.placements), _names(sheet, "tool", cell.tools)
    return replace(part, placement=placement, tool=tool, temperature=_temperature(sheet))


def _poses(sheet: Sheet, cell: Cell, trust_units: bool) -> Poses:
    turn = sheet.numbers("sigma_deg", float(np.degrees(cell.device("pose").turn_sigma)))
    return Poses(
        tuple(sheet.text("id")),
        joints_of(sheet, cell.robot, trust_units),
        block_of(sheet, POINT),
        np.radians(block_of(sheet, ANGLES)),
        sigma_of(sheet, cell.sigma("pose")),
        np.radians(turn),
        _names(sheet, "placement", cell.placements),
        _names(sheet, "tool", cell.tools),
        _temperature(sheet),
    )


def _distances(sheet: Sheet, cell: Cell, trust_units: bool) -> Distances:
    distance = sheet.numbers("distance_mm")
    for row in np.flatnonzero(distance <= 0).tolist():
        sheet.wrong(row, f"distance_mm is {distance[row]:g}, expected a length above 0")
    return Distances(
        tuple(sheet.text("id")),
        joints_of(sheet, cell.robot, trust_units),
        _points(sheet, "anchor", cell),
        distance,
        sigma_of(sheet, cell.sigma("distance")),
        _names(sheet, "placement", cell.placements),
        _names(sheet, "tool", cell.tools),
        _temperature(sheet),
    )


def _contacts(sheet: Sheet, cell: Cell, trust_units: bool) -> Contacts:
    return Contacts(
        tuple(sheet.text("id")),
        joints_of(sheet, cell.robot, trust_units),
        _points(sheet, "point", cell),
        sigma_of(sheet, cell.sigma("contact")),
        _names(sheet, "placement", cell.placements),
        _names(sheet, "tool", cell.tools),
        _temperature(sheet),
    )


def _points(sheet: Sheet, column: str, cell: Cell) -> tuple[str, ...]:
    """Names of points; each has to stand in the cell."""
    names = sheet.text(column)
    for row, name in enumerate(names):
        if name not in cell.points:
            text = f"{column} '{name}' is no point of the cell{nearest(name, cell.points)}; add it to points:"
            sheet.wrong(row, text if name else f"{column} is empty; name a point of the cell")
    return tuple(names)


def _names(sheet: Sheet, column: str, of_cell: Mapping[str, object]) -> tuple[str, ...] | None:
    """Names of further placements or tools, empty for the first; None if the file has no such column."""
    if column not in sheet.columns:
        return None
    names = sheet.text(column)
    for row, name in enumerate(names):
        if name and name not in of_cell:
            cure = f"add it to {column}s: as fit, or with its pose"
            sheet.wrong(row, f"{column} '{name}' is not in the cell{nearest(name, of_cell)}; {cure}")
    return tuple(names)


def _temperature(sheet: Sheet) -> Float[np.ndarray, " rows"] | None:
    """Temperatures [degC], NaN where a cell is empty; None if the file has no such column."""
    return sheet.numbers("temperature_c", float("nan")) if "temperature_c" in sheet.columns else None


def _check_payload(sheet: Sheet, cell: Cell) -> None:
    """Every row was measured with one payload, that of the cell if it states one."""
    if "payload_kg" not in sheet.columns:
        return
    payload = sheet.numbers("payload_kg", float("nan"))
    values = payload[~np.isnan(payload)]
    if not len(values):
        return
    reference = cell.robot.payload[0] if cell.robot.payload else float(values[0])
    for row in np.flatnonzero(np.abs(payload - reference) > 1e-9).tolist():
        text = f"payload_kg is {payload[row]:g}, other than {reference:g}: the robot bends otherwise"
        sheet.wrong(row, f"{text}; identify from measurements with one payload, that of payload: in cell.yaml")


READERS: dict[str, Callable[[Sheet, Cell, bool], Measurements]] = {
    "touch": _touches,
    "position": _positions,
    "pose": _poses,
    "distance": _distances,
    "contact": _contacts,
}
