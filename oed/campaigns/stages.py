"""The stages of a campaign, and the store that keeps them so that a campaign that was stopped goes on."""

from dataclasses import dataclass
from typing import Any, Protocol

from identify.model.cell import Cell
from identify.model.io.calibration_file import Calibration
from identify.model.touch import HIT, Plan, Touches


@dataclass(frozen=True, eq=False)
class Job:
    """The touches of one stage, and the cell as it is to be touched: what is believed, and how long to search."""

    number: int  # from 1
    cell: Cell  # with the searches of this stage and the robot as it is believed to be
    plan: Plan
    searching: bool  # the robot is so badly known that misses and collisions are to be expected
    deviation: float  # [mm], of the tip before the stage


@dataclass(frozen=True, eq=False)
class Stage:
    """One round of the loop."""

    job: Job
    touches: Touches  # whatever its status
    calibration: Calibration
    promised_mm: float | None  # 95 % of the poses, 95 of 100 such robots; None while the touches alone do not suffice

    @property
    def hits(self) -> int:
        """Touches that met something."""
        return sum(status == HIT for status in self.touches.status)


@dataclass(frozen=True, eq=False)
class Campaign:
    """What a campaign came to."""

    stages: tuple[Stage, ...]
    target_mm: float
    reached: bool
    why: str  # a sentence: why it ended

    @property
    def touches(self) -> int:
        """Touches that were tried."""
        return sum(len(stage.touches) for stage in self.stages)

    @property
    def calibration(self) -> Calibration:
        """The last one."""
        return self.stages[-1].calibration

    @property
    def promised_mm(self) -> float | None:
        """The last promise."""
        return self.stages[-1].promised_mm


class CampaignStore(Protocol):
    """Remembers stages, so that a campaign that was stopped goes on."""

    def planned(self, number: int) -> tuple[Plan, dict[str, Any]] | None:
        """The plan of a stage and what was noted with it, if there is one."""
        ...

    def keep_plan(self, number: int, plan: Plan, notes: dict[str, Any]) -> Plan:
        """Keep a plan before it is touched; the plan as it would be read again."""
        ...

    def keep_calibration(self, number: int, calibration: Calibration) -> None:
        """Keep what a stage has found."""
        ...


class NullStore:
    """Keeps nothing."""

    def planned(self, number: int) -> tuple[Plan, dict[str, Any]] | None:
        """There is none."""
        return None

    def keep_plan(self, number: int, plan: Plan, notes: dict[str, Any]) -> Plan:
        """Hand it back."""
        return plan

    def keep_calibration(self, number: int, calibration: Calibration) -> None:
        """Let it go."""
