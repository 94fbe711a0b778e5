"""The CSV files of touches, positions, plans and poses: columns with units in their names, radians inside.

Joint columns hold what the controller counts (`joints:` of the cell), which is read and written as joints of the model.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError, Sheet, read_sheet, sheet_text
from identify.model.robot import Robot
from identify.model.touch import HIT, STATUSES, Plan, Positions, Touches

PLANE = ("nx", "ny", "nz", "offset_mm")
VIAS = 9  # columns of postures on the way that are looked for
POINT = ("x_mm", "y_mm", "z_mm")
APPROACH = "approach_"  # before the joints from which a touch was searched


def joint_columns(robot: Robot, prefix: str = "") -> list[str]:
    """Names of the joint columns: q1_deg, q2_mm for a prismatic joint, ..."""
    return [f"{prefix}q{i + 1}_{'mm' if p else 'deg'}" for i, p in enumerate(robot.prismatic)]


def touch_columns(robot: Robot) -> list[str]:
    """The columns of touches.csv, in order."""
    columns = ["id", "time", "status", "face", *PLANE, "sigma_mm", *joint_columns(robot), "temperature_c", "note"]
    return [*columns, *joint_columns(robot, APPROACH)]


def read_touches(path: Path | str, cell: Cell, *, trust_units: bool = False) -> Touches:
    """Read the rows of touches.csv that happened (status hit, or no status column).

    Raises InputError with every mistake: unknown faces, numbers that are none, duplicate ids, radians, metres.
    """
    sheet = read_sheet(path, ["id", *joint_columns(cell.robot)], touch_columns(cell.robot))
    refuse_plan(sheet)
    sheet.ids()
    touches = touches_of(sheet, cell, trust_units)
    sheet.stop()
    return touches


def refuse_plan(sheet: Sheet) -> None:
    """Raise InputError for a plan, whose joint angles are those to reach and not those of a touch."""
    approach = any(name.startswith(APPROACH) for name in sheet.columns)
    if approach and "status" not in sheet.columns and {"face", *POINT} <= sheet.columns.keys():
        raise InputError(f"{sheet.file}: this is a plan, not touches; make them: touchcal run {sheet.file}")


def touches_of(sheet: Sheet, cell: Cell, trust_units: bool) -> Touches:
    """The touches of a sheet that happened; mistakes are noted in the sheet."""
    status = sheet.text("status", HIT)
    hit = np.array([s == HIT for s in status], dtype=bool)
    for row, value in enumerate(status):
        if value not in STATUSES:
            sheet.wrong(row, f"status is {value!r}, expected one of {', '.join(STATUSES)}")
    sheet = rows_of(sheet, hit)
    q = joints_of(sheet, cell.robot, trust_units)
    face, normal, offset = _planes(sheet, cell, trust_units)
    sigma = sigma_of(sheet, cell.touch.sigma)
    temperature = _optional(sheet, "temperature_c")
    approach = np.column_stack([_optional(sheet, name) for name in joint_columns(cell.robot, APPROACH)])
    ids = tuple(sheet.text("id"))
    return Touches(
        ids=ids,
        face=tuple(face),
        q=q,
        normal=normal,
        offset=offset,
        sigma=sigma,
        status=(HIT,) * len(ids),
        temperature=temperature,
        time=tuple(sheet.text("time")),
        note=tuple(sheet.text("note")),
        approach=cell.robot.from_controller(approach),
    )


def read_positions(path: Path | str, cell: Cell, *, trust_units: bool = False) -> Positions:
    """Read positions.csv: tip positions measured in the jig frame; raises InputError with every mistake."""
    sheet = read_sheet(path, ["id", *joint_columns(cell.robot), *POINT], ["sigma_mm"])
    sheet.ids()
    positions = positions_of(sheet, cell, trust_units)
    sheet.stop()
    return positions


def positions_of(sheet: Sheet, cell: Cell, trust_units: bool) -> Positions:
    """The positions of a sheet; mistakes are noted in the sheet."""
    ids, q = tuple(sheet.text("id")), joints_of(sheet, cell.robot, trust_units)
    point = block_of(sheet, POINT)
    sigma = sigma_of(sheet, cell.sigma("position"))
    spread = np.ptp(point, axis=0).max() if len(ids) > 1 else np.inf
    if spread < 10.0 and not trust_units:
        sheet.at(0, f"all positions lie within {spread:.3g} mm: metres? write millimetres, or say --trust-units")
    return Positions(ids, q, point, sigma)


def read_plan(path: Path | str, cell: Cell) -> Plan:
    """Read the touches of plan.csv; raises InputError with every mistake.

    Rows of other kinds are for operator and device: they are left out.
    """
    robot = cell.robot
    vias = [joint_columns(robot, f"via{k + 1}_") for k in range(VIAS)]
    sheet = read_sheet(
        path,
        ["id", "face", *POINT, *PLANE[:3], *joint_columns(robot), *joint_columns(robot, APPROACH)],
        ["kind", "does", *(name for via in vias for name in via)],
    )
    if "kind" in sheet.columns:
        touches = np.array([kind == "touch" for kind in sheet.text("kind")], dtype=bool)
        if not touches.any():
            sheet.at(0, "the plan holds no touches; make its measurements at their joints by hand or by your program")
        sheet = rows_of(sheet, touches)
    face = sheet.text("face")
    for row, name in enumerate(face):
        if "face" in sheet.columns and (cell.jig is None or name not in cell.jig.by_name):
            sheet.wrong(row, cell.unknown_face(name))
    joints = robot.from_controller
    plan = Plan(
        ids=tuple(sheet.ids()),
        face=tuple(face),
        point=block_of(sheet, POINT),
        normal=block_of(sheet, PLANE[:3]),
        q=joints(block_of(sheet, joint_columns(robot))),
        approach=joints(block_of(sheet, joint_columns(robot, APPROACH))),
        via=joints(_vias(sheet, vias)),
    )
    sheet.stop()
    return plan


def _vias(sheet: Sheet, vias: Sequence[Sequence[str]]) -> Float[np.ndarray, "rows vias joints"]:
    """Postures on the way, as many as the sheet has columns for; a row gives all joints of one, or none."""
    here = [names for names in vias if sheet.columns.keys() & set(names)]
    values = np.stack(
        [np.column_stack([_optional(sheet, name) for name in names]) for names in here]
        or [np.empty((len(sheet.lines), 0))],
        axis=1,
    )
    for k, names in enumerate(here):
        missing = np.isnan(values[:, k])
        for row in np.flatnonzero(missing.any(axis=1) & ~missing.all(axis=1)):
            sheet.wrong(int(row), f"{names[0]} to {names[-1]}: some are empty; write all of them, or none")
    return values if here else np.empty((len(sheet.lines), 0, len(vias[0])))


def plan_text(plan: Plan, robot: Robot) -> str:
    """A plan as the text of plan.csv."""
    columns: dict[str, Sequence[str] | np.ndarray] = {"id": plan.ids, "face": plan.face}
    columns |= dict(zip(POINT, plan.point.T.round(6), strict=True))
    columns |= dict(zip(PLANE[:3], plan.normal.T.round(12), strict=True))
    vias = [(f"via{k + 1}_", plan.via[:, k]) for k in range(plan.via.shape[1])]
    for prefix, q in (("", plan.q), (APPROACH, plan.approach), *vias):
        columns |= dict(zip(joint_columns(robot, prefix), robot.to_controller(q).T.round(9), strict=True))
    return sheet_text(columns)


def touches_text(touches: Touches, robot: Robot) -> str:
    """Touches as the text of touches.csv; a plane is written as numbers only where no face names it."""
    named = np.array([bool(name) for name in touches.face], dtype=bool)
    plane = np.column_stack([touches.normal, touches.offset])
    plane[named] = np.nan
    columns: dict[str, Sequence[str] | np.ndarray] = {
        "id": touches.ids,
        "time": touches.time,
        "status": touches.status,
        "face": touches.face,
    }
    columns |= dict(zip(PLANE, plane.T, strict=True))
    columns["sigma_mm"] = touches.sigma
    columns |= dict(zip(joint_columns(robot), robot.to_controller(touches.q).T.round(9), strict=True))
    columns |= {"temperature_c": touches.temperature, "note": touches.note}
    start = np.full_like(touches.q, np.nan) if touches.approach is None else touches.approach
    columns |= dict(zip(joint_columns(robot, APPROACH), robot.to_controller(start).T.round(9), strict=True))
    return sheet_text(columns)


def positions_text(positions: Positions, robot: Robot) -> str:
    """Positions as the text of positions.csv."""
    columns: dict[str, Sequence[str] | np.ndarray] = {"id": positions.ids}
    columns |= dict(zip(joint_columns(robot), robot.to_controller(positions.q).T.round(9), strict=True))
    columns |= dict(zip(POINT, positions.point.T.round(6), strict=True)) | {"sigma_mm": positions.sigma}
    return sheet_text(columns)


def rows_of(sheet: Sheet, keep: np.ndarray) -> Sheet:
    """The rows that are to be kept; mistakes go to the whole sheet."""
    columns = {name: [c for c, use in zip(cells, keep, strict=True) if use] for name, cells in sheet.columns.items()}
    lines = [line for line, use in zip(sheet.lines, keep, strict=True) if use]
    return Sheet(sheet.file, columns, lines, sheet.mistakes)


def block_of(sheet: Sheet, names: Sequence[str]) -> Float[np.ndarray, "rows columns"]:
    """Columns of numbers side by side."""
    return np.column_stack([sheet.numbers(name) for name in names])


def _optional(sheet: Sheet, name: str) -> np.ndarray:
    return sheet.numbers(name, float("nan")) if name in sheet.columns else np.full(len(sheet.lines), np.nan)


def joints_of(sheet: Sheet, robot: Robot, trust_units: bool) -> Float[np.ndarray, "rows joints"]:
    """Joints of the model [rad] or [mm] from what the controller counts."""
    values = block_of(sheet, joint_columns(robot))
    turning = values[:, ~np.array(robot.prismatic)]
    largest = np.nanmax(np.abs(turning), initial=0.0)
    if len(values) >= 3 and 0 < largest < 7 and not trust_units:
        sheet.at(0, f"no joint angle is larger than {largest:.3g}: radians? write degrees, or say --trust-units")
    return robot.from_controller(values)


def sigma_of(sheet: Sheet, default: float) -> np.ndarray:
    """Standard deviations [mm], the default where a cell is empty."""
    sigma = sheet.numbers("sigma_mm", default) if "sigma_mm" in sheet.columns else np.full(len(sheet.lines), default)
    for row in np.flatnonzero(sigma <= 0).tolist():
        sheet.wrong(
            row, f"sigma_mm is {sigma[row]:g}, expected a length above 0; leave it empty for the cell's {default:g}"
        )
    return sigma


def _planes(
    sheet: Sheet, cell: Cell, trust_units: bool
) -> tuple[list[str], Float[np.ndarray, "rows 3"], Float[np.ndarray, " rows"]]:
    """Face names, normals and offsets; a row names a face or gives a plane, not both."""
    face = sheet.text("face")
    planes = np.column_stack([_optional(sheet, name) for name in PLANE])
    faces = {} if cell.jig is None else cell.jig.by_name
    plane = planes.copy()
    if "face" not in sheet.columns and np.isnan(planes).any(axis=1).all():
        sheet.at(1, f"column 'face' is missing; write the face of each touch, or its plane in {', '.join(PLANE)}")
        raise InputError(sheet.mistakes)
    for row, name in enumerate(face):
        if name in faces:
            one = faces[name]
            plane[row] = (*one.normal, one.offset)
        elif name:
            sheet.wrong(row, cell.unknown_face(name))
        elif np.isnan(planes[row]).any():
            sheet.wrong(row, "neither a face nor a whole plane (nx, ny, nz, offset_mm); write one of them")
    by_numbers = np.array([not name for name in face], dtype=bool)
    length = np.linalg.norm(plane[:, :3], axis=1)
    for row in np.flatnonzero(np.abs(length - 1) > 1e-6).tolist():
        sheet.wrong(row, f"the normal has length {length[row]:.6g}, expected 1; divide nx, ny, nz by {length[row]:.6g}")
    differs = ~by_numbers & (np.nan_to_num(np.abs(planes - plane)).max(axis=1, initial=0.0) > 1e-4)
    for row in np.flatnonzero(differs).tolist():
        sheet.wrong(row, f"the plane in numbers is not that of face '{face[row]}'; keep one of the two")
    if by_numbers.sum() >= 3 and not trust_units and 0 < np.abs(planes[by_numbers, 3]).max() < 5.0:
        sheet.at(
            0, "no plane lies further than 5 mm from the jig's origin: metres? write millimetres, or say --trust-units"
        )
    return face, plane[:, :3], plane[:, 3]
