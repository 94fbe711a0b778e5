"""A virtual robot at an approach, and where its tip is."""

import numpy as np

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.virtual.robot import VirtualRobot
from probe.virtual.truth import Truth


def robot_at(cell: Cell, truth: Truth, plan: Plan, touch: int = 0) -> VirtualRobot:
    return VirtualRobot(cell, truth, np.random.default_rng(5), start=plan.approach[touch])


def tip(cell: Cell, q: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
    return cell.kinematics.tip(q[None], cell.theta if theta is None else theta)[0][0]
