"""What devices read of a robot that is truly otherwise than drawn: tables of any kind but touches."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.frames import euler, rotation
from identify.model.ik import reach
from identify.model.measurement import Measurements, measurement_model, rows
from identify.model.touch import Contacts, Distances, Poses, Positions, Touches
from identify.uncertainty.named_unknowns import Named, named, placed


def draw_named(cell: Cell, rng: np.random.Generator) -> dict[str, Float[np.ndarray, " coordinates"]]:
    """Further placements, tools and points of a cell as they may truly be [mm, rad], by the name of each unknown.

    Those that are to be fitted stand at 0.
    """
    return {
        f"{unknown.column}.{unknown.name}": unknown.nominal
        + unknown.precision * unknown.scale * rng.standard_normal(len(unknown.nominal))
        for unknown in named(cell)
    }


def readings(
    cell: Cell,
    table: Measurements,
    theta: Float[np.ndarray, " parameters"],
    rng: np.random.Generator,
    further: Mapping[str, Float[np.ndarray, " coordinates"]] | None = None,
) -> Measurements:
    """The table as a robot `theta` gives it, with the scatter that it states; `further` as of `draw_named`.

    Of contacts the joints are read, and those out of the robot's reach are left out; of all others the device reads.
    Raises ValueError for touches, which `touch_batch` makes.
    """
    if isinstance(table, Touches):
        raise ValueError("touches are made by touch_batch: what they read are the joints where the wire met the face")
    table_rows = rows(cell.wire, [table], cell.robot, cell.places)
    values: list[tuple[Named, np.ndarray]] = [
        (unknown, (further or {}).get(f"{unknown.column}.{unknown.name}", unknown.nominal)) for unknown in named(cell)
    ]
    each, table_rows = placed(theta, table_rows, values)
    each = np.tile(each, (len(table_rows), 1)) if each.ndim == 1 else each
    off = measurement_model(cell.robot).residual(each, table_rows) + table_rows.sigma * rng.standard_normal(
        len(table_rows)
    )
    first = np.flatnonzero(np.diff(table_rows.owner, prepend=-1))
    if isinstance(table, Distances):
        return replace(table, distance=table.distance + off)
    if isinstance(table, Contacts):
        assert table_rows.places is not None
        target = table_rows.places[first, :3] + table_rows.sigma[first, None] * rng.standard_normal((len(table), 3))
        R = cell.kinematics.tip(table.q, each[first])[1]
        cases = zip(each[first], target, R, table.q, strict=True)
        parts = [reach(cell.kinematics, t, p[None], turned[None], q[None]) for t, p, turned, q in cases]
        seated = np.array([part.reached()[0] for part in parts], dtype=bool)
        return replace(table, q=np.concatenate([part.q for part in parts])).take(seated)
    size = len(table_rows) // len(table)
    shift = off.reshape(len(table), size)[:, :3]
    if isinstance(table, Poses):
        R = cell.kinematics.tip(table.q, each[first])[1]
        turn = rotation(*(table.turn_sigma * rng.standard_normal((3, len(table)))))
        return replace(table, point=table.point + shift, angles=euler(turn @ R))
    assert isinstance(table, Positions)
    return replace(table, point=table.point + shift)
