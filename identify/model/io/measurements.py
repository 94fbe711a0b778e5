"""Files that hold measurements of any kind: which kind a row is follows from the columns that it fills."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

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
from identify.model.touch import Contacts, Distances, Poses

NAN = float("nan")
ANGLES = ("rz_deg", "ry_deg", "rx_deg")
CONDITIONS = ("sigma_mm", "sigma_deg", "placement", "tool", "payload_kg", "temperature_c", "note")
COLUMNS = {"distance": ("anchor", "distance_mm"), "contact": ("point",), "pose": ANGLES, "position": POINT}
"""Columns by which a row shows its kind; a row that fills none of them is a touch."""


def read_measurements(path: Path | str, cell: Cell, *, trust_units: bool = False) -> tuple[Measurements, ...]:
    """Read touches, positions, poses, distances and contacts, a table each; raises InputError with every mistake.

    Rows may name a further `placement` or `tool` of the cell, and the temperature and the payload of the robot.
    """
    usual = [*touch_columns(cell.robot), *CONDITIONS, *(c for columns in COLUMNS.values() for c in columns)]
    sheet = read_sheet(path, ["id", *joint_columns(cell.robot)], usual)
    refuse_plan(sheet)
    sheet.ids()
    _check_payload(sheet, cell)
    kinds = _kinds(sheet)
    tables = [
        _with_conditions(READERS[kind](part, cell, trust_units), part, cell)
        for kind in dict.fromkeys(kinds or ["touch"])
        for part in [_part(sheet, [k == kind for k in kinds])]
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
        own_columns = (*POINT, *ANGLES) if kind == "pose" else COLUMNS[kind]
        for name in (name for name in own_columns if name not in sheet.columns):
            sheet.at(1, f"column '{name}' of a {kind} is missing")
    return kinds


def _filled(sheet: Sheet, columns: Sequence[str]) -> list[bool]:
    """Whether each row has something in one of some columns."""
    cells = [sheet.columns[name] for name in columns if name in sheet.columns]
    return [any(cell.strip() for cell in row) for row in zip(*cells, strict=True)] or [False] * len(sheet.lines)


def _part(sheet: Sheet, rows: Sequence[bool]) -> Sheet:
    return sheet if all(rows) else rows_of(sheet, np.array(rows))


def _poses(sheet: Sheet, cell: Cell, trust_units: bool) -> Poses:
    turn = sheet.numbers("sigma_deg", float(np.degrees(cell.device("pose").turn_sigma)))
    return Poses(
        tuple(sheet.text("id")),
        joints_of(sheet, cell.robot, trust_units),
        block_of(sheet, POINT),
        np.radians(block_of(sheet, ANGLES)),
        sigma_of(sheet, cell.sigma("pose")),
        np.radians(turn),
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
    )


def _contacts(sheet: Sheet, cell: Cell, trust_units: bool) -> Contacts:
    return Contacts(
        tuple(sheet.text("id")),
        joints_of(sheet, cell.robot, trust_units),
        _points(sheet, "point", cell),
        sigma_of(sheet, cell.sigma("contact")),
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


def _with_conditions(table: Measurements, sheet: Sheet, cell: Cell) -> Measurements:
    """A table and how its rows were measured: stand, tool, temperature and payload, where the file has columns."""
    part = rows_of(sheet, np.isin(sheet.text("id"), table.ids))  # touches that missed are not in the table
    columns: dict[str, Any] = {"placement": _names(part, "placement", cell.placements)}
    columns["tool"] = _names(part, "tool", cell.tools)
    for field, column in {"temperature": "temperature_c", "payload": "payload_kg"}.items():
        if column in sheet.columns and getattr(table, field) is None:
            columns[field] = part.numbers(column, NAN)
    return replace(table, **columns)


def _check_payload(sheet: Sheet, cell: Cell) -> None:
    """Payloads are no less than nothing; where they differ, the cell says what the robot carries and where."""
    payload = sheet.numbers("payload_kg", NAN) if "payload_kg" in sheet.columns else np.empty(0)
    masses = payload[~np.isnan(payload)]
    for row in np.flatnonzero(payload < 0).tolist():
        sheet.wrong(row, f"payload_kg is {payload[row]:g}, expected the mass at the flange, 0 or more")
    for row in np.flatnonzero(np.abs(payload - masses[:1]) > 1e-9).tolist() if cell.robot.payload is None else ():
        text = f"payload_kg is {payload[row]:g}, other than {masses[0]:g}, and nothing says where it hangs"
        sheet.wrong(row, f"{text}; write payload: {{mass_kg: {masses[0]:g}, centre_mm: [x, y, z]}} into cell.yaml")


READERS: dict[str, Callable[[Sheet, Cell, bool], Measurements]] = {
    "touch": touches_of,
    "position": positions_of,
    "pose": _poses,
    "distance": _distances,
    "contact": _contacts,
}
