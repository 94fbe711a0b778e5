"""The cell in which the tests run LinuxCNC: a plan, and the robot as it really is."""

from dataclasses import replace

import numpy as np
from virtual_support import make_plan

from identify.model.cell import Cell
from identify.model.io.description import library, read_cell
from identify.model.touch import Plan

COUNT = 12
SPEED = 20.0  # [mm/s] of the search
HOME = np.zeros(6)  # [rad]


CELL = f"""
robot: library:arc-welder
jig: library:step-block
base: {{x_mm: 340, y_mm: 740, z_mm: 350, rz_deg: -90, ry_deg: 0, rx_deg: 0}}
tool: {{x_mm: 0, y_mm: 0, z_mm: 410, rz_deg: 0, ry_deg: -18, rx_deg: 0}}
touch: {{approach_mm: 10, travel_mm: 25, speed_mm_s: {SPEED}}}
"""


def cell_of_the_test() -> Cell:
    """The paper's cell, in more of a hurry; one for each thread."""
    cell = read_cell(library("cells")["arc-welder"])
    return replace(cell, touch=replace(cell.touch, approach=10.0, travel=25.0, speed=SPEED))


def true_robot(cell: Cell) -> np.ndarray:
    """Off by a tenth of its tolerances: a few millimetres at the tip."""
    return cell.theta + 0.1 * cell.scale * np.random.default_rng(1).standard_normal(len(cell.theta))


def in_the_clear(cell: Cell, a: np.ndarray, b: np.ndarray, margin: float = 6.0) -> bool:
    tip = cell.kinematics.tip(a + np.linspace(0, 1, 80)[:, None] * (b - a), cell.theta)[0]
    inside = [
        ((tip > np.array(x.lower) - margin) & (tip < np.array(x.upper) + margin)).all(axis=1) for x in cell.jig.boxes
    ]
    return not np.any(inside)


def short_plan(cell: Cell, count: int) -> Plan:
    """Touches on several faces, in an order in which the tip keeps away from the jig in between."""
    pool = make_plan(replace(cell, touch=replace(cell.touch, approach=25.0)), 160, seed=2)
    approach = pool.q + (pool.approach - pool.q) * cell.touch.approach / 25.0

    def continued(order: list[int]) -> list[int] | None:
        """Depth first: what is near, on faces that had few touches so far, comes first."""
        if len(order) == count:
            return order
        made = [pool.face[i] for i in order]
        here = approach[order[-1]] if order else HOME
        rest = set(range(len(pool))) - set(order)
        for i in sorted(rest, key=lambda i: made.count(pool.face[i]) / 4 + np.abs(approach[i] - here).max()):
            if in_the_clear(cell, here, approach[i]) and (longer := continued([*order, i])):
                return longer
        return None

    order = continued([])
    assert order is not None
    plan = replace(pool, approach=approach).take(np.array(order))
    return replace(plan, ids=tuple(f"t{i + 1:02d}" for i in range(count)))


def gap(cell: Cell, theta: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Distance of the true wire's end from the nearest face it stands before [mm]."""
    tip, R = cell.kinematics.tip(q, theta)
    nearest = np.full(len(q), np.inf)
    for face in cell.jig.faces:
        off = tip @ face.normal - face.offset - cell.wire.radius * np.sqrt(1 - (R[:, :, 2] @ face.normal) ** 2)
        before = ((face.fractions(tip) >= 0) & (face.fractions(tip) <= 1)).all(axis=1) & (off > -5.0)
        nearest = np.where(before, np.minimum(nearest, off), nearest)
    return nearest


def contact(cell: Cell, theta: np.ndarray, approach: np.ndarray, planned: np.ndarray) -> np.ndarray:
    """Joints at which the true wire first meets the jig on the way of a search, between finer and finer steps."""
    low, high = 0.0, 2.0
    for _ in range(4):
        s = np.linspace(low, high, 301)
        first = int(np.flatnonzero(gap(cell, theta, approach + s[:, None] * (planned - approach)) <= 0)[0])
        low, high = s[first - 1], s[first]
    return approach + high * (planned - approach)


def ways(cell: Cell, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """How far the true tip travels between rows of joints [mm]."""
    theta = true_robot(cell)
    return np.linalg.norm(cell.kinematics.tip(b, theta)[0] - cell.kinematics.tip(a, theta)[0], axis=1)
