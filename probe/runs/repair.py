"""Rows of touches.csv that its journal does not know: which of them can be believed, and why the others cannot."""

import csv
from collections.abc import Iterable

import numpy as np

from identify.model.cell import Cell
from identify.model.io.tables import joint_columns, touch_columns
from identify.model.touch import HIT, STATUSES, Plan
from probe.motion.joint_path import Geometry
from probe.motion.settings import Settings
from probe.runs.records import AGAIN

LISTED = 5  # rows named one by one


def row_objection(line: str, cell: Cell, plan: Plan) -> str:
    """Why a row of touches.csv cannot be a touch of this plan, or nothing.

    A hit must lie on the line of its search, as every touch that counts: a flipped digit leads off it.
    """
    columns = touch_columns(cell.robot)
    if not line.isprintable():
        return "it holds a character that cannot be printed"
    cells = next(csv.reader([line]), [])
    if len(cells) != len(columns):
        return f"it has {len(cells)} columns, expected {len(columns)}"
    row = dict(zip(columns, cells, strict=True))
    name = row["id"].partition(AGAIN)[0]
    if name not in plan.ids:
        return f"the plan has no touch '{name}'"
    i = plan.ids.index(name)
    if row["face"] != plan.face[i] or row["status"] not in STATUSES:
        return f"it says {row['status']} on '{row['face']}', the plan has '{plan.face[i]}'"
    try:
        q = np.array([float(row[column]) for column in joint_columns(cell.robot)]) * cell.robot.joint_unit()
        float(row["temperature_c"] or 0)
    except ValueError:
        return "a number cannot be read"
    if not np.isfinite(q).all() or ((q < cell.robot.lower) | (q > cell.robot.upper)).any():
        return "its joints are beyond their limits"
    geometry = Geometry(cell, Settings())
    at, off = geometry.fraction(q, plan.approach[i], plan.q[i])
    if row["status"] == HIT and (at <= 0 or off > geometry.settings.off_line):
        return f"its joints lie {np.degrees(off):.3f} deg off the line of its search"
    return ""


def sound_rows(text: str, header: str, cell: Cell, plan: Plan, ids: Iterable[str]) -> tuple[list[str], list[str]]:
    """Rows that can be adopted, and a sentence for each that cannot; rows of `known` touches are passed over.

    Rows are taken one by one, so that one damaged row costs no other; of rows with the same id the first sound one
    is taken.
    """
    sound, broken, names = list[str](), list[str](), set(ids)
    for place, line in enumerate(text.split("\n")[:-1], 1):
        name = line.split(",")[0]
        if line == header or not line.strip() or name in names:
            continue
        if reason := row_objection(line, cell, plan):
            broken.append(f"row {place} is left out: {reason}")
        else:
            sound.append(line)
            names.add(name)
    return sound, broken


def listed(sentences: list[str]) -> str:
    """Some sentences as one."""
    more = len(sentences) - LISTED
    return "; ".join(sentences[:LISTED] + ([f"and {more} more"] if more > 0 else []))
