"""What was measured: touches on faces, positions and poses of the tip, distances, contacts; columns of equal length."""

from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

HIT = "hit"
STATUSES = (HIT, "miss", "early", "skipped", "outlier")


T = TypeVar("T", bound="Table")


class Table:
    """A frozen table: every field is a column, and all columns have as many entries as there are rows."""

    ids: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.ids)

    def take(self: T, index: np.ndarray) -> T:
        """The rows of an integer or boolean index, in its order."""
        rows = np.arange(len(self))[index]
        columns = {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]
        filled = {k: c for k, c in columns.items() if c is not None}
        picked = {k: c[rows] if isinstance(c, np.ndarray) else tuple(c[i] for i in rows) for k, c in filled.items()}
        return replace(self, **picked)  # type: ignore[type-var]

    def measured(self: T) -> T:
        """The rows that hold a measurement."""
        return self


@dataclass(frozen=True, eq=False)
class Touches(Table):
    """Touches that happened: the joint values that the encoders read when the wire met a plane."""

    ids: tuple[str, ...]
    """A name of each row, none twice."""
    face: tuple[str, ...]
    """Empty where the plane was given as numbers."""
    q: Float[np.ndarray, "touches joints"]
    """[rad] or [mm]."""
    normal: Float[np.ndarray, "touches 3"]
    """Outward, in the jig frame."""
    offset: Float[np.ndarray, " touches"]
    """[mm]."""
    sigma: Float[np.ndarray, " touches"]
    """[mm], of the contact along the normal, not of the place of the face."""
    status: tuple[str, ...]
    """One of STATUSES; fits use hits alone."""
    temperature: Float[np.ndarray, " touches"]
    """[degC], NaN where not read."""
    time: tuple[str, ...]
    """When, as ISO 8601; empty where not recorded."""
    note: tuple[str, ...]
    """Free text."""
    approach: Float[np.ndarray, "touches joints"] | None = None
    """[rad] or [mm] where the search began; NaN: not known."""
    placement: tuple[str, ...] | None = None
    """Names of further stands of the jig; None or empty: its first."""
    tool: tuple[str, ...] | None = None
    """Names of further wires; None or empty: the tool of the cell."""
    payload: Float[np.ndarray, " touches"] | None = None
    """[kg] that the flange carried, NaN where not recorded."""

    def measured(self) -> "Touches":
        """The touches of status hit."""
        hits = np.array([status == HIT for status in self.status], dtype=bool)
        return self if hits.all() else self.take(hits)


def joined(a: Touches, b: Touches) -> Touches:
    """The touches of both, in their order; a column that one of them lacks is lacking."""
    columns: dict[str, Any] = {}
    for name in (f.name for f in fields(Touches)):
        first, second = getattr(a, name), getattr(b, name)
        if first is not None and second is not None:
            columns[name] = np.concatenate([first, second]) if isinstance(first, np.ndarray) else first + second
    return Touches(**columns)


@dataclass(frozen=True, eq=False)
class Positions(Table):
    """Tip positions measured in the jig frame, or in that of a further placement, by a tracker for instance."""

    ids: tuple[str, ...]
    """A name of each row, none twice."""
    q: Float[np.ndarray, "positions joints"]
    """[rad] or [mm]."""
    point: Float[np.ndarray, "positions 3"]
    """[mm]."""
    sigma: Float[np.ndarray, " positions"]
    """[mm]."""
    placement: tuple[str, ...] | None = None
    """Names of further stands; None or empty: the jig's own."""
    tool: tuple[str, ...] | None = None
    """Names of further targets; None or empty: the tool of the cell."""
    temperature: Float[np.ndarray, " positions"] | None = None
    """[degC], NaN where not read."""
    payload: Float[np.ndarray, " positions"] | None = None
    """[kg] that the flange carried, NaN where not recorded."""


@dataclass(frozen=True, eq=False)
class Poses(Table):
    """Tip poses measured in the jig frame, or in that of a further placement."""

    ids: tuple[str, ...]
    q: Float[np.ndarray, "poses joints"]
    """[rad] or [mm]."""
    point: Float[np.ndarray, "poses 3"]
    """[mm]."""
    angles: Float[np.ndarray, "poses 3"]
    """[rad], rz, ry, rx with R = Rz Ry Rx."""
    sigma: Float[np.ndarray, " poses"]
    """[mm]."""
    turn_sigma: Float[np.ndarray, " poses"]
    """[rad] about each axis."""
    placement: tuple[str, ...] | None = None
    tool: tuple[str, ...] | None = None
    temperature: Float[np.ndarray, " poses"] | None = None
    """[degC], NaN where not read."""
    payload: Float[np.ndarray, " poses"] | None = None
    """[kg] that the flange carried, NaN where not recorded."""


@dataclass(frozen=True, eq=False)
class Distances(Table):
    """Distances of the tip from named points, by a ball bar or a draw wire for instance."""

    ids: tuple[str, ...]
    q: Float[np.ndarray, "distances joints"]
    """[rad] or [mm]."""
    anchor: tuple[str, ...]
    """Names of points of the cell."""
    distance: Float[np.ndarray, " distances"]
    """[mm]."""
    sigma: Float[np.ndarray, " distances"]
    """[mm]."""
    placement: tuple[str, ...] | None = None
    tool: tuple[str, ...] | None = None
    temperature: Float[np.ndarray, " distances"] | None = None
    """[degC], NaN where not read."""
    payload: Float[np.ndarray, " distances"] | None = None
    """[kg] that the flange carried, NaN where not recorded."""


@dataclass(frozen=True, eq=False)
class Contacts(Table):
    """The tip in named points: a ball in a socket, a tip at a tip."""

    ids: tuple[str, ...]
    q: Float[np.ndarray, "contacts joints"]
    """[rad] or [mm]."""
    point: tuple[str, ...]
    """Names of points of the cell."""
    sigma: Float[np.ndarray, " contacts"]
    """[mm]."""
    placement: tuple[str, ...] | None = None
    tool: tuple[str, ...] | None = None
    temperature: Float[np.ndarray, " contacts"] | None = None
    """[degC], NaN where not read."""
    payload: Float[np.ndarray, " contacts"] | None = None
    """[kg] that the flange carried, NaN where not recorded."""


@dataclass(frozen=True, eq=False)
class Plan(Table):
    """Touches to be made: contact points on faces, and the joint values of contact and of approach."""

    ids: tuple[str, ...]
    """A name of each row, none twice."""
    face: tuple[str, ...]
    """Names of faces of the jig; empty where nothing is touched."""
    point: Float[np.ndarray, "touches 3"]
    """[mm], in the jig frame."""
    normal: Float[np.ndarray, "touches 3"]
    """Outward, in the jig frame."""
    q: Float[np.ndarray, "touches joints"]
    """[rad] or [mm], at contact by the model the plan was made with."""
    approach: Float[np.ndarray, "touches joints"]
    """[rad] or [mm]."""
    via: Float[np.ndarray, "touches vias joints"] = field(default_factory=lambda: np.empty((0, 0, 0)))
    """Postures on the way there from the touch before; rows of NaN fill up where fewer are needed than elsewhere."""

    def __post_init__(self) -> None:
        if len(self.via) != len(self.q):
            object.__setattr__(self, "via", np.empty((len(self.q), 0, self.q.shape[1])))

    def way(self, i: int) -> Float[np.ndarray, "postures joints"]:
        """The postures that lead to touch i, its approach the last."""
        via = self.via[i]
        return np.vstack([via[~np.isnan(via).any(axis=1)], self.approach[i : i + 1]])
