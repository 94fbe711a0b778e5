"""A robot without a line before the jig, and a plan that it can make."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from run_bench import Bench
from touching import clear_plan, pointed

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.motion.room import Room


@pytest.fixture(scope="session")
def cell(arc_welder: Cell) -> Cell:
    return pointed(arc_welder)


@pytest.fixture(scope="session")
def plan(cell: Cell) -> Plan:
    return clear_plan(cell, 8)


@pytest.fixture
def bench(cell: Cell, plan: Plan, tmp_path: Path) -> Bench:
    return Bench(cell, plan, tmp_path)


@pytest.fixture
def block(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[np.ndarray], bool]], None]:
    """Take the ways to some postures out of the room."""
    route = Room.route

    def block(blocked: Callable[[np.ndarray], bool]) -> None:
        def routed(room: Room, start: np.ndarray, goal: np.ndarray, via: Sequence[np.ndarray] = ()) -> list[np.ndarray]:
            return [] if blocked(goal) else route(room, start, goal, via)

        monkeypatch.setattr(Room, "route", routed)

    return block
