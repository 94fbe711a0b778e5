"""What a virtual robot tells: how motions ended, what was really executed, what truly happened at each latch."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

MOVE, SEARCH = "MOVE", "SEARCH"
OK, CONTACT, NOCONTACT = "OK", "CONTACT", "NOCONTACT"
NEVER = float("inf")


@dataclass(frozen=True, eq=False)
class Outcome:
    """How a motion ended: OK, CONTACT, NOCONTACT or the code of an error."""

    kind: str
    q: Float[np.ndarray, " joints"]  # [rad] or [mm], latched, or where the robot stands
    stop: Float[np.ndarray, " joints"]
    text: str = ""


@dataclass(frozen=True, eq=False)
class Executed:
    """One motion that was really made, and how it ended; for the judge, not for the driver."""

    kind: str
    q: Float[np.ndarray, " joints"]  # commanded
    rate: float  # [rad/s]
    began: float  # [s]
    ended: float  # [s]
    outcome: Outcome


@dataclass(frozen=True, eq=False)
class Truly:
    """What truly happened at a latch; for the judge, not for the driver."""

    time: float  # [s] of the contact
    latched: float  # [s]
    surface: str  # empty where nothing solid was met
    q: Float[np.ndarray, " joints"]  # encoders at the contact
    arm: Float[np.ndarray, " joints"]  # joints behind the gears at the contact
    latch: Float[np.ndarray, " joints"]  # encoders at the latch
    theta: Float[np.ndarray, " parameters"]  # the wire as long as it was
    shift: float  # [mm] of the scatter: the contact closed that much before the face


@dataclass
class Health:
    """What may be wrong with the machine."""

    homed: bool = True
    estop: bool = False
    stuck: bool = False  # the contact reads closed, whatever the wire does
    open: bool = False  # the wire is broken: nothing is ever felt
    bounce: float | None = None  # [s] of chatter; None: the truth's
