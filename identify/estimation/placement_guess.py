"""Where further placements, tools and points stand that nobody measured: a closed-form start from what was measured."""

import numpy as np
from jaxtyping import Bool, Float

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.frames import nearest_rotation, pose, transform
from identify.model.measurement import Rows
from identify.uncertainty.unknowns import Unknowns

TIE = 1e-9  # of a rotation: where the rows leave a turn open, it is none
FIRST = ""  # name of the placement that the jig itself is


def with_further(
    unknowns: Unknowns, x: Float[np.ndarray, " unknowns"], rows: Rows, theta: Float[np.ndarray, " parameters"]
) -> Float[np.ndarray, " unknowns"]:
    """The start x [prior deviations], with what is to be fitted where it stands by the robot as it starts."""
    if not any(unknown.precision == 0 for unknown in unknowns.named):
        return x
    x, guess = x.copy(), further_start(unknowns.cell, rows, theta)
    first = len(unknowns) - sum(len(unknown.nominal) for unknown in unknowns.named)
    for unknown in unknowns.named:
        part = slice(first, first + len(unknown.nominal))
        if unknown.precision == 0:
            x[part] = (guess[f"{unknown.column}.{unknown.name}"] - unknown.nominal) / unknown.scale
        first = part.stop
    return x


def further_start(cell: Cell, rows: Rows, theta: Float[np.ndarray, " parameters"]) -> dict[str, np.ndarray]:
    """Coordinates [mm, rad] of placements, tools and points that are to be fitted, by names like placement.second.

    The robot is taken as it starts. Points come first, each from the placement that saw it; then placements from the
    points and planes that they saw. Raises InputError if nothing was measured of one.
    """
    places = {name: p.position for name, p in cell.points.items() if p.position is not None}
    stands = {FIRST: theta[:6]} | {name: frame for name, frame in cell.placements.items() if frame is not None}
    open_points = [name for name, p in cell.points.items() if p.position is None]
    open_stands = [name for name, frame in cell.placements.items() if frame is None]
    tips = _tips(cell, rows, theta)
    while open_points or open_stands:
        tied_stands = [name for name in open_stands if _seen(rows, places, name)]
        for name in tied_stands:
            stands[name] = _stand(cell, rows, tips, places, name)
            open_stands.remove(name)
        tied_points = [name for name in open_points if any(_rows_of(rows, stand, name).any() for stand in stands)]
        for name in tied_points:
            places[name] = _point(rows, tips, stands, name)
            open_points.remove(name)
        if not tied_stands and not tied_points:
            if not open_stands:
                raise InputError(f"point '{open_points[0]}' was not measured; measure it, or take it out of points:")
            name = open_stands.pop(0)  # nothing ties it to the others: its frame is that of the robot's base
            if not rows.named("placement", name).any():
                raise InputError(f"placement '{name}' was not measured; measure there, or take it out of placements:")
            stands[name] = np.zeros(6)
    tools = {f"tool.{name}": np.zeros(6) for name, frame in cell.tools.items() if frame is None}
    out = {f"placement.{name}": stands[name] for name, frame in cell.placements.items() if frame is None} | tools
    return out | {f"point.{name}": places[name] for name, p in cell.points.items() if p.position is None}


def _tips(cell: Cell, rows: Rows, theta: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, "rows 3"]:
    """The tip of each row in the frame of the robot's base [mm], by its own tool."""
    tip = np.empty((len(rows), 3))
    for name in ("", *cell.tools):
        frame = theta[-6:] if not name else cell.tools[name]
        here = rows.named("tool", name) if rows.tool else np.full(len(rows), not name)
        if here.any():
            of_base = np.concatenate([np.zeros(6), theta[6:-6], np.zeros(6) if frame is None else frame])
            tip[here] = cell.kinematics.tip(rows.q[here], of_base)[0]
    return tip


def _rows_of(rows: Rows, stand: str, point: str) -> Bool[np.ndarray, " rows"]:
    """Contacts with a point at a placement."""
    here = rows.named("placement", stand) if rows.placement else np.full(len(rows), stand == FIRST)
    return here & rows.named("point", point) & rows.named("equation", "contact")


def _seen(rows: Rows, places: dict[str, np.ndarray], stand: str) -> bool:
    """Whether a placement saw planes, positions or points that are known."""
    here = rows.named("placement", stand)
    planes = here & (rows.named("equation", "plane") if rows.equation else here)
    return bool(planes.any() or any(_rows_of(rows, stand, name).any() for name in places))


def _point(
    rows: Rows, tips: Float[np.ndarray, "rows 3"], stands: dict[str, np.ndarray], name: str
) -> Float[np.ndarray, " 3"]:
    """The mean of the tips in a point, by the first placement that saw it."""
    stand = next(stand for stand in stands if _rows_of(rows, stand, name).any())
    jig_T_base = transform(stands[stand])
    tip = tips[_rows_of(rows, stand, name)].mean(axis=0)
    return np.asarray(jig_T_base[:3, :3] @ tip + jig_T_base[:3, 3])


def _stand(
    cell: Cell, rows: Rows, tips: Float[np.ndarray, "rows 3"], places: dict[str, np.ndarray], name: str
) -> Float[np.ndarray, " 6"]:
    """The pose of a placement from planes n . (R t + p) = c and points: linear in R and p; R is then projected."""
    here = np.flatnonzero(rows.named("placement", name))
    n, c, t = rows.normal[here], rows.offset[here].copy(), tips[here]
    for k, row in enumerate(here):
        if rows.point and rows.point[row] in places:
            c[k] = n[k] @ places[rows.point[row]]
    use = np.linalg.norm(n, axis=1) > 0
    n, c, t = n[use], c[use], t[use]
    middle = t.mean(axis=0)
    A = np.concatenate([np.einsum("mi,mj->mij", n, t - middle).reshape(len(n), 9), n], axis=1)
    x = np.linalg.lstsq(A, c, rcond=1e-9)[0]
    R = nearest_rotation(x[:9].reshape(3, 3) + TIE * np.eye(3))
    p = np.linalg.lstsq(n, c - np.einsum("mi,ij,mj->m", n, R, t), rcond=None)[0]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return pose(T)
