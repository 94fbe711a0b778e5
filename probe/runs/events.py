"""What happens while touches are made, for a screen or a log to show."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Started:
    """The plan is found sound; the first motion is next."""

    total: int  # touches of the plan
    done: int  # of them, in an earlier run
    controller: str


@dataclass(frozen=True)
class Touching:
    """A touch is begun, or begun again."""

    id: str
    face: str
    attempt: int  # from 1


@dataclass(frozen=True)
class Retried:
    """An attempt did not count, and why."""

    id: str
    attempt: int
    reason: str


@dataclass(frozen=True)
class Touched:
    """A touch has its row in touches.csv."""

    id: str
    face: str
    status: str  # as in touches.csv
    residual: float  # [mm] along the normal against the nominal model; NaN where nothing was touched
    surprise: float  # [mm] against what the touches so far predict; NaN where nothing was touched
    expected: float  # [mm], 1 sigma of that prediction
    attempts: int
    note: str
    done: int
    total: int
    seconds_left: float  # NaN where not known yet


@dataclass(frozen=True)
class Drifted:
    """A point was touched again."""

    id: str
    change: float  # [mm] along the normal since its first touch


@dataclass(frozen=True)
class Waiting:
    """Nothing moves for a moment, and why."""

    reason: str


@dataclass(frozen=True)
class Recovered:
    """After a failure, the robot is back where it is safe."""

    reason: str


@dataclass(frozen=True)
class Finished:
    """The plan is done."""

    hits: int
    total: int
    seconds: float
    skipped: Mapping[str, str] = field(default_factory=dict)  # the reason by touch: refused, or without a clear way


Event = Started | Touching | Retried | Touched | Drifted | Waiting | Recovered | Finished
Listener = Callable[[Event], None]


def ignore(event: Event) -> None:
    """Listen to nothing."""
