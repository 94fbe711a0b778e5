"""What a session remembers: motions that were asked for, readings that were taken, and what came of each touch."""

import csv
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from identify.model.io.tables import joint_columns, touch_columns
from identify.model.robot import Robot

AGAIN = "~"  # t017~2 is the second touch of the point t017


@dataclass(frozen=True, eq=False)
class Intent:
    """A motion about to be asked for, written down before it is."""

    kind: str  # move | search | fast | retract
    id: str  # of the touch it serves
    boot: str
    sequence: int
    start: Float[np.ndarray, " joints"]  # [rad] or [mm]
    end: Float[np.ndarray, " joints"]
    back: Float[np.ndarray, " joints"]  # where to go when it fails
    rate: float  # [rad/s]


APPROACH, CONTACT, RETRACTED = "approach", "contact", "retracted"  # where the robot stands when it is observed


@dataclass(frozen=True, eq=False)
class Observation:
    """What the controller said while the robot stood still: before a search, on its contact, after its retract."""

    place: str  # APPROACH | CONTACT | RETRACTED
    boot: str
    q: Float[np.ndarray, " joints"]  # [rad] or [mm]
    closed: bool  # the touch input


@dataclass(frozen=True, eq=False)
class Reading:
    """Joint values at a latch and how fast they changed, so that a known delay can be taken back."""

    q: Float[np.ndarray, " joints"]  # [rad] or [mm]
    velocity: Float[np.ndarray, " joints"]  # [rad/s] or [mm/s]


@dataclass(frozen=True, eq=False)
class Result:
    """What came of a touch: one row of touches.csv, and what the journal keeps beyond it."""

    id: str
    face: str
    status: str
    reading: Reading  # where it ended when nothing was touched
    fast: Reading | None = None  # of the quick search before
    time: str = ""
    temperature: float = float("nan")  # [degC]
    note: str = ""


def result_of(record: dict[str, Any], robot: Robot) -> Result:
    """A result record of the journal, or the row in it where the rest is unknown."""
    row = dict(zip(touch_columns(robot), next(csv.reader([record["line"]])), strict=True))
    unit = robot.joint_unit()

    def joints(key: str) -> Float[np.ndarray, " joints"]:
        return np.array(record[key]) * unit if key in record else np.full(len(unit), np.nan)

    q = robot.from_controller(np.array([float(row[name] or "nan") for name in joint_columns(robot)]))
    fast = Reading(joints("fast_q"), joints("fast_velocity")) if "fast_q" in record else None
    temperature = float(row["temperature_c"] or "nan")
    return Result(
        row["id"],
        row["face"],
        row["status"],
        Reading(q, joints("velocity")),
        fast,
        row["time"],
        temperature,
        row["note"],
    )
