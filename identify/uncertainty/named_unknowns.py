"""Unknowns that rows name: frames of further placements and tools, and coordinates of points."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.measurement import Rows
from identify.model.robot import POSE_NAMES


@dataclass(frozen=True, eq=False)
class Named:
    """Six coordinates of a frame that rows use in place of the base or the tool, or three of a point.

    Rows whose `column` holds the name have these unknowns in their equation.
    """

    column: Literal["placement", "tool", "point"]
    name: str
    nominal: Float[np.ndarray, " size"]  # [mm, rad]; 0 for what is to be fitted
    scale: Float[np.ndarray, " size"]  # [mm, rad], 1 sigma of the prior, or the unit of what is to be fitted
    precision: float  # 1, or 0 if nothing is known before the measurements

    @property
    def names(self) -> list[str]:
        """Names of the unknowns."""
        return [f"{self.column}.{self.name}.{axis}" for axis in POSE_NAMES[: len(self.nominal)]]

    @property
    def units(self) -> list[Literal["mm", "deg"]]:
        """Their units in files and on screens."""
        return ["mm", "mm", "mm", "deg", "deg", "deg"][: len(self.nominal)]  # type: ignore[return-value]


def named(cell: Cell) -> Iterator[Named]:
    """The further placements, tools and points of a cell, apart from points that are exact."""
    for column, frames, sigma in (
        ("placement", cell.placements, cell.priors.base),
        ("tool", cell.tools, cell.priors.tool),
    ):
        for name, frame in frames.items():
            scale = np.repeat(sigma, 3)
            nominal = np.zeros(6) if frame is None else frame
            yield Named(column, name, nominal, scale, float(frame is not None))  # type: ignore[arg-type]
    for name, point in cell.points.items():
        if point.position is None:
            yield Named("point", name, np.zeros(3), np.full(3, cell.priors.base[0]), 0.0)
        elif point.sigma > 0:
            yield Named("point", name, point.position, np.full(3, point.sigma), 1.0)


def placed(theta: np.ndarray, rows: Rows, values: list[tuple[Named, np.ndarray]]) -> tuple[np.ndarray, Rows]:
    """Parameters of each row, with its own base and tool, and the rows with the coordinates of their points."""
    whole, places = theta, rows.places
    for unknown, value in values:
        if unknown.column == "point":
            for column, part in (("point", slice(0, 3)), ("second", slice(3, 6))):
                here = rows.named(column, unknown.name)
                if places is not None and here.any():
                    places = places.copy()
                    places[here, part] = value
        elif (here := rows.named(unknown.column, unknown.name)).any():
            whole = np.tile(theta, (len(rows), 1)) if whole.ndim == 1 else whole
            whole[here, _frame(unknown)] = value
    return whole, rows if places is rows.places else replace(rows, places=places)


def columns(
    unknown: Named, rows: Rows, J: Float[np.ndarray, "rows parameters"], P: Float[np.ndarray, "rows 6"]
) -> Float[np.ndarray, "rows size"]:
    """Derivatives of residuals by the coordinates of one unknown [mm/mm, mm/rad].

    A frame takes over the columns of the base or the tool in its rows: there they are set to 0 in J.
    """
    if unknown.column == "point":
        first, second = (rows.named(column, unknown.name)[:, None] for column in ("point", "second"))
        return first * P[:, :3] + second * P[:, 3:]
    here, frame = rows.named(unknown.column, unknown.name), _frame(unknown)
    out = np.zeros((len(J), 6))
    out[here] = J[here, frame]
    J[here, frame] = 0.0
    return out


def _frame(unknown: Named) -> slice:
    """Where the base or the tool stands among the parameters."""
    return slice(0, 6) if unknown.column == "placement" else slice(-6, None)
