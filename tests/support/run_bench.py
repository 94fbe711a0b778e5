"""A robot without a line before the jig, a session on the disk, and what a run tells."""

from pathlib import Path

import numpy as np
from touching import Direct, Ticks, World, disturbed

from identify.model.cell import Cell
from identify.model.io.tables import read_touches
from identify.model.touch import Plan, Touches
from probe.motion.joint_path import Geometry
from probe.motion.settings import Settings
from probe.runs import events
from probe.runs.execution import run
from probe.runs.session import Session, journal_path

USUAL = Settings(search_speed=10.0)


class Bench:
    """A robot before the jig, a session on the disk, and what was told."""

    def __init__(self, cell: Cell, plan: Plan, folder: Path) -> None:
        self.cell, self.plan, self.path = cell, plan, folder / "touches.csv"
        self.clock = Ticks()
        self.world = World(cell, disturbed(cell), self.clock, plan.approach[0])
        self.robot = Direct(self.world)
        self.told: list[events.Event] = []

    def run(self, settings: Settings = USUAL, plan: Plan | None = None) -> events.Finished:
        plan, resume = plan or self.plan, journal_path(self.path).exists()
        with Session(self.path, self.cell, plan, resume=resume, clock=self.clock) as session:
            return run(plan, self.robot, session, settings, tell=self.told.append, clock=self.clock)

    def status(self) -> dict[str, str]:
        rows = [line.split(",") for line in self.path.read_text().splitlines()[1:]]
        return {row[0]: row[2] for row in rows}

    def hits(self) -> Touches:
        return read_touches(self.path, self.cell)

    def reasons(self) -> list[str]:
        return [event.reason for event in self.told if isinstance(event, events.Retried)]

    def only_back_after(self, count: int) -> bool:
        """Whether the first motion after `count` motions led along the last one to the approach where it was safe."""
        (start, end), (again, back) = self.world.motions[count - 1 : count + 1]
        line = (start - end) / np.linalg.norm(start - end)
        on_line = np.abs(back - again - (back - again) @ line * line).max() < 1e-6
        return bool(on_line and np.abs(self.plan.approach - back).max(axis=1).min() < 1e-6)


def hidden(geometry: Geometry, ends: np.ndarray) -> bool:
    """Whether a finer look finds the tip in the jig between two postures."""
    tip = geometry.tip(ends[0] + np.linspace(0, 1, 500)[:, None] * (ends[1] - ends[0]))
    assert geometry.cell.jig is not None
    return any(((tip > box.lower) & (tip < box.upper)).all(axis=1).any() for box in geometry.cell.jig.boxes)
