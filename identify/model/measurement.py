"""Kinds of measurements: from the tables of what was measured to rows, which are scalar equations.

A new kind is a table in `touch`, a function that makes its rows, and a row in MEASUREMENTS. An equation that no other
kind has is a residual in CasADi symbols and a row in `equations.EQUATIONS`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell, Wire
from identify.model.equations import LEVER, MeasurementModel, Rows, measurement_model
from identify.model.frames import rotation
from identify.model.joint_error_models import FURTHER
from identify.model.robot import Robot
from identify.model.touch import Contacts, Distances, Poses, Positions, Touches

__all__ = [
    "MEASUREMENTS",
    "Kind",
    "MeasurementModel",
    "Measurements",
    "Rows",
    "equations",
    "measurement_model",
    "rows",
    "spacing_rows",
    "tip_rows",
    "touch_conditions",
]
STILL = 1e-4  # [rad] or [mm] that a joint may move on the way to a touch without a direction

Measurements = Touches | Positions | Poses | Distances | Contacts
Places = Mapping[str, Float[np.ndarray, " 3"]]  # coordinates [mm] of named points


def rows(wire: Wire, tables: Sequence[Measurements], robot: Robot | None = None, places: Places | None = None) -> Rows:
    """The equations of measurements, in their order.

    Temperature and payload of a measurement count from those of the robot; without it, none counts. `places` [mm] are
    the points that distances and contacts name.
    """
    parts = [_of(table).rows(wire, table, places or {}) for table in tables]
    first = np.cumsum([0, *(len(table) for table in tables)])
    whole = _concatenated(parts)
    return replace(
        whole,
        ids=tuple(name for table in tables for name in table.ids),
        owner=np.concatenate([part.owner + start for part, start in zip(parts, first[:-1], strict=True)]),
        conditions=np.concatenate([_conditions(*pair, robot) for pair in zip(tables, parts, strict=True)]),
        face=tuple(name for part in parts for name in part.face or ("",) * len(part)),
        placement=_spread(tables, parts, "placement"),
        tool=_spread(tables, parts, "tool"),
    )


def equations(cell: Cell, tables: Sequence[Measurements]) -> Rows:
    """The rows of measurements in a cell, and those of the spacings between points that they name."""
    whole = rows(cell.wire, tables, cell.robot, cell.places)
    here = set(whole.point)
    pairs = [(s.start, s.end, s.distance, s.sigma) for s in cell.spacings if here & {s.start, s.end}]
    if not pairs:
        return whole
    further = spacing_rows(pairs, cell.places, len(cell.robot.joints))
    both, count = _concatenated([whole, further]), len(whole)
    blank = ("",) * len(further)
    conditions = np.zeros((len(further), len(cell.robot.joints) + FURTHER))
    return replace(
        both,
        ids=whole.ids + further.ids,
        owner=np.concatenate([whole.owner, further.owner + len(whole.ids)]),
        conditions=None if whole.conditions is None else np.vstack([whole.conditions, conditions]),
        face=whole.face + blank if whole.face else (),
        second=("",) * count + further.second,
        placement=whole.placement + blank if whole.placement else (),
        tool=whole.tool + blank if whole.tool else (),
    )


def _concatenated(parts: Sequence[Rows]) -> Rows:
    """The rows of all parts, ids and owners those of each."""
    q, normal, offset, radius, sigma, owner = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("q", "normal", "offset", "radius", "sigma", "owner")
    )
    return Rows(
        q,
        normal,
        offset,
        radius,
        sigma,
        parts[0].ids,
        owner,
        equation=_joined(parts, "equation", "plane"),
        point=_joined(parts, "point", ""),
        places=_stacked(parts, "places", 6),
        turn=_stacked(parts, "turn", 9),
    )


def _of(table: Measurements) -> "Kind":
    return next(kind for kind in MEASUREMENTS.values() if isinstance(table, kind.table))


def _joined(parts: Sequence[Rows], column: str, usual: str) -> tuple[str, ...]:
    """A column of names of all parts; () if all are the usual one."""
    names = tuple(name for part in parts for name in getattr(part, column) or (usual,) * len(part))
    return names if any(name != usual for name in names) else ()


def _stacked(parts: Sequence[Rows], column: str, width: int) -> np.ndarray | None:
    """A column of numbers of all parts; None if no part has it."""
    if all(getattr(part, column) is None for part in parts):
        return None
    blank = (np.zeros((len(part), width)) for part in parts)
    columns = (getattr(part, column) for part in parts)
    return np.concatenate([b if c is None else c for b, c in zip(blank, columns, strict=True)])


def _spread(tables: Sequence[Measurements], parts: Sequence[Rows], column: str) -> tuple[str, ...]:
    """The names that stand with measurements, one a row; () if there are none."""
    if not any(getattr(table, column) for table in tables):
        return ()
    names = tuple(
        (getattr(table, column) or ("",) * len(table))[i]
        for table, part in zip(tables, parts, strict=True)
        for i in part.owner
    )
    return names if any(names) else ()


def _conditions(table: Measurements, part: Rows, robot: Robot | None) -> Float[np.ndarray, "rows conditions"]:
    """Direction of every joint into a touch, warmth [K] and further payload; 0 where not recorded."""
    warmth = beyond = np.zeros(len(table))
    temperature, payload = (getattr(table, name, None) for name in ("temperature", "payload"))
    if robot is not None and temperature is not None:
        warmth = np.nan_to_num(temperature - robot.temperature)
    if robot is not None and robot.payload is not None and payload is not None:
        beyond = np.nan_to_num(payload / robot.payload[0] - 1)
    approach = table.approach if isinstance(table, Touches) else None
    return touch_conditions(table.q, approach, warmth, beyond)[part.owner]


def touch_conditions(
    q: Float[np.ndarray, "rows joints"],
    approach: Float[np.ndarray, "rows joints"] | None,
    warmth: Float[np.ndarray, " rows"] | float = 0.0,
    beyond: Float[np.ndarray, " rows"] | float = 0.0,
) -> Float[np.ndarray, "rows conditions"]:
    """Conditions of touches searched from an approach, so much [K] above the reference, with so much more payload."""
    step = np.zeros_like(q) if approach is None else q - approach
    direction = np.where(np.abs(step) > STILL, np.sign(step), 0.0)  # NaN, not recorded, is not above STILL
    return np.column_stack([direction, np.broadcast_to(warmth, len(q)), np.broadcast_to(beyond, len(q))])


def _touch_rows(wire: Wire, touches: Touches, places: Places) -> Rows:
    """Equation n . tip - c - h = 0 of the plane that each touch met."""
    m = len(touches)
    offset, radius = touches.offset + wire.ball, np.full(m, wire.flat)
    return Rows(touches.q, touches.normal, offset, radius, touches.sigma, touches.ids, np.arange(m), face=touches.face)


def _axes(q: np.ndarray, offset: np.ndarray, sigma: np.ndarray, ids: tuple[str, ...]) -> Rows:
    """Three rows a measurement, along x, y and z."""
    m = len(ids)
    return Rows(
        np.repeat(q, 3, axis=0),
        np.tile(np.eye(3), (m, 1)),
        offset.ravel(),
        np.zeros(3 * m),
        np.repeat(sigma, 3),
        ids,
        np.repeat(np.arange(m), 3),
    )


def _position_rows(wire: Wire, positions: Positions | Poses, places: Places) -> Rows:
    """Equations tip - p = 0."""
    return _axes(positions.q, positions.point, positions.sigma, positions.ids)


def _pose_rows(wire: Wire, poses: Poses, places: Places) -> Rows:
    """Equations tip - p = 0 and, at a lever, the turn from the measured to the modelled rotation = 0."""
    m = len(poses)
    turns = _axes(poses.q, np.zeros((m, 3)), poses.turn_sigma * LEVER, poses.ids)
    matrix = rotation(*poses.angles.T).reshape(m, 9)
    turns = replace(turns, equation=("turn",) * (3 * m), turn=np.repeat(matrix, 3, axis=0))
    points = _position_rows(wire, poses, places)
    order = np.argsort(np.concatenate([points.owner, turns.owner]), kind="stable")
    return _concatenated([points, turns]).take(order)


def _distance_rows(wire: Wire, distances: Distances, places: Places) -> Rows:
    """|tip - anchor| - d = 0."""
    m, zeros = len(distances), np.zeros(len(distances))
    return Rows(
        distances.q,
        np.zeros((m, 3)),
        distances.distance,
        zeros,
        distances.sigma,
        distances.ids,
        np.arange(m),
        equation=("distance",) * m,
        point=distances.anchor,
        places=_coordinates(distances.anchor, places),
    )


def _contact_rows(wire: Wire, contacts: Contacts, places: Places) -> Rows:
    """Equations tip - point = 0."""
    plain = _axes(contacts.q, np.zeros((len(contacts), 3)), contacts.sigma, contacts.ids)
    names = tuple(contacts.point[i] for i in plain.owner)
    return replace(plain, equation=("contact",) * len(plain), point=names, places=_coordinates(names, places))


def _coordinates(names: Sequence[str], places: Places) -> Float[np.ndarray, "rows 6"]:
    """Coordinates of named points; 0 for those that are to be fitted."""
    zero = np.zeros(3)
    return np.array([[*places.get(name, zero), 0.0, 0.0, 0.0] for name in names]).reshape(len(names), 6)


def spacing_rows(pairs: Sequence[tuple[str, str, float, float]], places: Places, joints: int) -> Rows:
    """|a - b| - d = 0 of pairs of named points, with d and its sigma [mm]; no robot takes part."""
    m = len(pairs)
    ends = np.hstack([_coordinates([str(pair[k]) for pair in pairs], places)[:, :3] for k in (0, 1)])
    return Rows(
        np.zeros((m, joints)),
        np.zeros((m, 3)),
        np.array([pair[2] for pair in pairs]),
        np.zeros(m),
        np.array([pair[3] for pair in pairs]),
        tuple(f"spacing {a} {b}" for a, b, _, _ in pairs),
        np.arange(m),
        np.zeros((m, joints + FURTHER)),
        equation=("spacing",) * m,
        point=tuple(pair[0] for pair in pairs),
        second=tuple(pair[1] for pair in pairs),
        places=ends,
    )


@dataclass(frozen=True)
class Kind:
    """A kind of measurement: its table, its rows, the columns of its file beside id and joints, and what it needs."""

    table: type
    rows: Callable[[Wire, Any, Places], Rows]
    columns: tuple[str, ...]
    needs: str  # of the cell
    does: str = "stand still and measure"  # what device or operator do for one; {name} stands for a column of the table
    equations: int = 1  # scalar ones of a measurement


MEASUREMENTS: dict[str, Kind] = {
    "touch": Kind(Touches, _touch_rows, ("face",), "a jig, or a plane with each touch", "search {face}"),
    "position": Kind(
        Positions,
        _position_rows,
        ("x_mm", "y_mm", "z_mm"),
        "a tracker in the jig frame",
        "stand still; the tracker reads the position",
        3,
    ),
    "pose": Kind(
        Poses,
        _pose_rows,
        ("x_mm", "y_mm", "z_mm", "rz_deg", "ry_deg", "rx_deg"),
        "a tracker of six axes",
        "stand still; the tracker reads the pose",
        6,
    ),
    "distance": Kind(
        Distances,
        _distance_rows,
        ("anchor", "distance_mm"),
        "points: with the anchors",
        "stand still; read the distance to {anchor}",
    ),
    "contact": Kind(
        Contacts,
        _contact_rows,
        ("point",),
        "points: with the sockets",
        "bring the tip into {point}; read the joints",
        3,
    ),
}
"""Kinds of measurements by their names. A further one is also a row of COLUMNS and READERS (`io.measurements`) and,
to be planned, of POSTURES (`oed.candidates.kinds`); its table has fields placement, tool, temperature, payload."""


def tip_rows(q: Float[np.ndarray, "poses joints"], sigma: float = 1.0) -> Rows:
    """Three rows a pose along x, y and z through the origin: the tip position itself as a residual."""
    ids = tuple(str(i) for i in range(len(q)))
    return rows(Wire(0.0, "point"), [Positions(ids, q, np.zeros((len(q), 3)), np.full(len(q), sigma))])
