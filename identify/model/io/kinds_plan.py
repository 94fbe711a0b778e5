"""Plans of several kinds of measurements as plan.csv, and the table beside it in which readings are written."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identify.model.files import sheet_text
from identify.model.io.tables import APPROACH, PLANE, POINT, joint_columns
from identify.model.measurement import MEASUREMENTS, Measurements
from identify.model.robot import Robot
from identify.model.touch import Plan

NAMES = ("anchor", "point", "placement", "tool")  # columns of names that a table may have


@dataclass(frozen=True, eq=False)
class PlanPart:
    """The planned measurements of one kind, in the order of making them."""

    kind: str
    plan: Plan  # postures, and ways to them; approach and posture are one except for touches
    table: Measurements | None  # what they would read; None for touches

    def does(self, i: int) -> str:
        """What device or operator do at measurement i."""
        columns = {name: self.name(name, i) for name in NAMES} | {"face": self.plan.face[i]}
        further = [f"{name} {columns[name]}" for name in ("placement", "tool") if columns[name]]
        return ", ".join([MEASUREMENTS[self.kind].does.format(**columns), *further])

    def name(self, column: str, i: int) -> str:
        """The name in a column at measurement i; empty if it has none."""
        values = getattr(self.table, column, None)
        return values[i] if isinstance(values, tuple) else ""


def whole_plan(parts: Sequence[PlanPart]) -> Plan:
    """The postures of all parts, one after the other."""
    plans = [part.plan for part in parts]
    most = max(plan.via.shape[1] for plan in plans)
    via = [np.pad(p.via, ((0, 0), (0, most - p.via.shape[1]), (0, 0)), constant_values=np.nan) for p in plans]
    point, normal, q, approach = (
        np.concatenate([getattr(plan, name) for plan in plans]) for name in ("point", "normal", "q", "approach")
    )
    ids, face = (tuple(name for plan in plans for name in getattr(plan, column)) for column in ("ids", "face"))
    return Plan(ids, face, point, normal, q, approach, np.concatenate(via))


def kinds_plan_text(parts: Sequence[PlanPart], robot: Robot) -> str:
    """A plan as the text of plan.csv: the columns of a plan of touches, with the kind of each row and what is done."""
    plan = whole_plan(parts)
    touch = np.array([part.kind == "touch" for part in parts for _ in part.plan.ids], dtype=bool)
    normal = np.where(touch[:, None], plan.normal, np.nan)
    each = [(part, i) for part in parts for i in range(len(part.plan))]
    columns: dict[str, Sequence[str] | np.ndarray] = {
        "id": plan.ids,
        "kind": [part.kind for part, _ in each],
        "does": [part.does(i) for part, i in each],
        "face": plan.face,
    }
    columns |= dict(zip(POINT, plan.point.T.round(6), strict=True))
    columns |= dict(zip(PLANE[:3], normal.T.round(12), strict=True))
    vias = [(f"via{k + 1}_", plan.via[:, k]) for k in range(plan.via.shape[1])]
    for prefix, q in (("", plan.q), (APPROACH, plan.approach), *vias):
        columns |= dict(zip(joint_columns(robot, prefix), robot.to_controller(q).T.round(9), strict=True))
    return sheet_text(columns)


def readings_text(parts: Sequence[PlanPart], robot: Robot) -> str:
    """A table of all measurements but touches, with the joints as planned and empty columns for what is read.

    Filled in, it is a file that `read_measurements` takes.
    """
    some = [part for part in parts if part.table is not None]
    each = [(part, i) for part in some for i in range(len(part.plan))]
    plan = whole_plan(some)
    columns: dict[str, Sequence[str] | np.ndarray] = {"id": plan.ids}
    columns |= dict(zip(joint_columns(robot), robot.to_controller(plan.q).T.round(9), strict=True))
    names = {name: [part.name(name, i) for part, i in each] for name in NAMES}
    columns |= {name: values for name, values in names.items() if any(values)}
    read = (column for part in some for column in MEASUREMENTS[part.kind].columns if column not in NAMES)
    return sheet_text(columns | {column: ("",) * len(plan) for column in dict.fromkeys(read)})
