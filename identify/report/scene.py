"""What the 3-D view shows, as plain data: jig, zone, touches, and the robot at each of them."""

from typing import Any

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell

MOST = 300  # touches that can be stepped through: the page stays small


def scene(
    cell: Cell,
    theta: Float[np.ndarray, " parameters"] | None,
    ids: tuple[str, ...],
    faces: tuple[str, ...],
    q: Float[np.ndarray, "touches joints"],
    words: tuple[str, ...],
) -> dict[str, Any]:
    """Everything in the jig frame [mm]; `theta` is the identified robot, None where there is only the nominal one."""
    jig, zone = cell.jig, cell.zone
    nominal = _skeletons(cell, cell.theta, q[:MOST])
    identified = None if theta is None else _skeletons(cell, theta, q[:MOST])
    return {
        "faces": [
            {"name": f.name, "origin": f.origin.tolist(), "u": f.u.tolist(), "v": f.v.tolist()}
            for f in (jig.faces if jig else ())
        ],
        "boxes": [{"lower": b.lower, "upper": b.upper} for b in (jig.boxes if jig else ())],
        "zone": None if zone is None else {"lower": zone.box[:, 0].tolist(), "upper": zone.box[:, 1].tolist()},
        "touches": [
            {"id": ids[i], "face": faces[i], "words": words[i], "nominal": nominal[i].tolist()}
            | ({} if identified is None else {"identified": identified[i].tolist()})
            for i in range(len(nominal))
        ],
        "left": max(0, len(q) - MOST),
    }


def _skeletons(
    cell: Cell, theta: Float[np.ndarray, " parameters"], q: Float[np.ndarray, "touches joints"]
) -> Float[np.ndarray, "touches points 3"]:
    """Origins of the link frames, and the tip, to a tenth of a millimetre."""
    if not len(q):
        return np.empty((0, len(cell.robot.joints) + 2, 3))
    frames = cell.kinematics.links(q, theta)
    tip = cell.kinematics.tip(q, theta)[0]
    return np.stack([*(T[:, :, 3] for T in frames), tip], axis=1).round(1)
