"""The torch as capsules on the last link, made from where the cell says that the tip is."""

import numpy as np

from identify.model.cell import Cell
from identify.model.frames import transform
from identify.model.joint import Capsule

STICKOUT = 18.0  # [mm] of bare wire before the nozzle
NOZZLE, BODY = 10.0, 20.0  # [mm], radii of the gas nozzle and of the torch behind it
ROUND = (
    0.36  # of the nozzle's radius: the capsule's round end, drawn back so that at 50 degrees it is as low as the rim
)
FLANGE = 30.0  # [mm] in front of the flange, where the body begins


def torch(cell: Cell) -> tuple[Capsule, ...]:
    """Nozzle and body of a torch whose wire ends at the tip: straight back along the wire, then over to the flange.

    Capsules that the robot file gives for its last link are taken for the torch in their place.
    """
    robot = cell.robot
    last = len(robot.joints)
    own = tuple(c for c in robot.capsules if c.link == last)
    if own or cell.tool is None:
        return own
    last_T_tip = robot.last_T_flange @ transform(cell.tool)
    tip, wire, flange = last_T_tip[:3, 3], last_T_tip[:3, 2], robot.last_T_flange[:3, 3]
    if not cell.neck:
        return ()
    neck = tip - cell.neck * wire
    nozzle = _capsule(last, tip - (STICKOUT + ROUND * NOZZLE) * wire, neck, NOZZLE)
    body = neck - flange
    length = float(np.linalg.norm(body))
    if length < FLANGE + BODY:  # nothing bulky between flange and neck
        return (nozzle,)
    return nozzle, _capsule(last, flange + FLANGE / length * body, neck, BODY)


def _capsule(link: int, start: np.ndarray, end: np.ndarray, radius: float) -> Capsule:
    (a, b, c), (x, y, z) = start.tolist(), end.tolist()
    return Capsule(link, (a, b, c), (x, y, z), radius)
