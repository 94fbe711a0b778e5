"""How far to stay from the edges of a face: a robot that is off must still land on it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Cell

SIGMAS = 2.5  # of the tip's predicted deviation that a touch should survive
SHARE = 0.8  # of half a face's width, the most that uncertainty takes from each side: the middle fifth stays
EDGE = 3.0  # [mm], least distance from an edge: chamfers, and half the wire
TYPICAL = 90  # percentile of the deviation over the postures that touch a face


@dataclass(frozen=True, eq=False)
class Margins:
    """What touches on each face keep in reserve."""

    deviation: Float[np.ndarray, "faces 3"]  # [mm], 1 sigma of the tip along u, v and the normal; NaN: not reached
    inset: Float[np.ndarray, "faces 2"]  # [mm], from the edges along u and v
    overtravel: Float[np.ndarray, " faces"]  # [mm], of the search beyond the planned contact


def margins(
    cell: Cell,
    root: Float[np.ndarray, "parameters directions"],
    theta: Float[np.ndarray, " parameters"],
    face: Int[np.ndarray, " postures"],
    q: Float[np.ndarray, "postures joints"],
    share: float = SHARE,
) -> Margins:
    """Insets and overtravel from the deviation of the tip at postures that touch the faces.

    The deviation is that of J_tip theta for parameters whose covariance is root root', SIGMAS of it; the inset is no
    more than `share` of half the width of a face, and the search no longer than the cell allows.
    """
    faces = cell.the_jig.faces
    deviation = np.full((len(faces), 3), np.nan)
    _, J = cell.kinematics.tip_jacobian(q, theta)
    for i in np.unique(face):
        axes = np.stack([faces[i].u / faces[i].size[0], faces[i].v / faces[i].size[1], faces[i].normal])
        sigma = np.linalg.norm(axes @ (J[face == i] @ root), axis=2)
        deviation[i] = np.percentile(sigma, TYPICAL, axis=0)
    size = np.stack([f.size for f in faces])
    need = SIGMAS * np.nan_to_num(deviation, nan=np.inf)
    inset = np.minimum(np.maximum(need[:, :2], EDGE), np.maximum(share * size / 2, EDGE))
    room = max(cell.touch.travel - cell.touch.approach, 0.0)
    return Margins(deviation, inset, np.minimum(np.maximum(need[:, 2], EDGE), room))


def warnings(cell: Cell, edges: Margins, touched: Bool[np.ndarray, " faces"]) -> tuple[str, ...]:
    """Sentences on faces that a robot as uncertain as this one may miss, and on searches that may not meet them."""
    faces, touch = cell.the_jig.faces, cell.touch
    out = []
    need = SIGMAS * np.where(touched[:, None], edges.deviation, 0.0)
    if len(narrow := np.flatnonzero((need[:, :2] > edges.inset + 1e-9).any(axis=1))):
        out.append(
            f"the tip may be up to {need[narrow, :2].max():.0f} mm off ({SIGMAS:g} sigma), but touches stay only "
            f"{_span(edges.inset[narrow])} mm from the edges of {', '.join(faces[i].name for i in narrow)}, or little "
            "of these faces would be left."
        )
    if (deep := need[:, 2].max(initial=0.0)) > min(touch.approach, touch.travel - touch.approach):
        out.append(
            f"the tip may be up to {deep:.0f} mm too near to a face or too far from it ({SIGMAS:g} sigma); the search "
            f"begins {touch.approach:g} mm before the planned contact and ends {touch.travel - touch.approach:g} mm "
            "behind it: measure base_mm and tool_mm better, or enlarge approach_mm and travel_mm."
        )
    return tuple(out)


def _span(values: Float[np.ndarray, "..."]) -> str:
    low, high = f"{values.min():.0f}", f"{values.max():.0f}"
    return low if low == high else f"{low} to {high}"
