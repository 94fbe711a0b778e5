"""What a robot controller can be asked, whatever line it hangs on, and what can come back."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

CODES = {
    "LIMIT": "a joint limit lies in the way",
    "ALREADY": "the touch input was closed before the search began",
    "EARLY": "the wire touched something during a move",
    "NOTREACHED": "the target was not reached",
    "STOPPED": "the motion was stopped",
    "DEADMAN": "the controller stopped because it heard nothing from here",
    "ESTOP": "the emergency stop is pressed",
    "UNHOMED": "the machine is not homed",
    "OLDSEQ": "the command is older than one already executed",
    "SYNTAX": "the controller did not understand the command",
    "BUSY": "another motion is still running",
    "NOLATCH": "no touch is latched",
    "ROBOT": "it is another robot",
    "BOOT": "the command was meant for an earlier start of the controller",
    "ASTRAY": "the robot did not move as it was told, and was stopped",
    "LOST": "the command never arrived, nothing moved",
}


@dataclass(frozen=True, eq=False)
class State:
    """What the controller says of itself at one moment."""

    boot: str  # drawn anew at each start of the controller; empty where it cannot tell
    moving: bool
    contact: bool  # the touch input, as it is now
    q: Float[np.ndarray, " joints"]  # [rad] or [mm]
    sequence: int  # number of the last command it began
    homed: bool = True  # as far as it tells; one that does not refuses to move


@dataclass(frozen=True, eq=False)
class Contact:
    """A search that met something."""

    q: Float[np.ndarray, " joints"]  # [rad] or [mm], latched when the input closed
    stop: Float[np.ndarray, " joints"]  # where the robot came to rest
    boot: str
    sequence: int  # of the search that latched


@dataclass(frozen=True, eq=False)
class NoContact:
    """A search that reached its end and met nothing."""

    q: Float[np.ndarray, " joints"]  # [rad] or [mm], where the robot stands


@dataclass(frozen=True, eq=False)
class Latch:
    """The last latch that the controller remembers, and the search it belongs to."""

    q: Float[np.ndarray, " joints"]  # [rad] or [mm]
    boot: str
    sequence: int


class TouchError(Exception):
    """The touches cannot go on; one sentence says why and what to do."""


class InTheWay(TouchError):
    """No clear way leads to a touch, by what the touches so far tell of the robot."""


class NotReady(TouchError):
    """The machine is not as it must be before the first motion: nothing has moved, and the operator puts it right."""


class LinkLost(TouchError):
    """The controller does not answer, or its port is gone; where the robot stands is not known."""


class Unwritten(LinkLost):
    """The port took too long to take bytes: it is jammed, or this computer is busy; nobody knows how many it took."""


class Rebooted(TouchError):
    """The controller has started anew: its position is not trusted until the operator says so."""


class Refused(TouchError):
    """The controller answered that it did not do, or not finish, what was asked; the robot stands still.

    `code` is a key of CODES; a backend translates its own errors into one of them, and keeps the words in `text`.
    """

    def __init__(self, code: str, text: str = "") -> None:
        self.code = code
        self.text = text
        super().__init__(f"{CODES.get(code, code)}{f' ({text})' if text else ''}")


class Controller(Protocol):
    """A robot that moves straight in joint space, stops when the wire touches, and remembers where.

    Joint values are radians (millimetres where a joint slides), absolute; a backend converts them for its line.
    `rate` [rad/s] is the speed of the fastest joint of the motion; a sliding joint's mm/s count as deg/s, as they do
    in TOUCH/1. So a motion takes `max(abs(counts at its end - counts at its start)) / degrees(rate)` seconds, counts =
    robot.to_controller(q), which is q / robot.joint_unit() where the controller counts as the model does.

    All calls block until the robot stands still again, keep the controller's deadman fed, repair a spoiled line by
    themselves, and may be interrupted by KeyboardInterrupt: the caller then calls `stop`. They raise LinkLost,
    Rebooted or Refused and nothing else; after any of them the controller object may be used again, and tells the
    truth about where things stand, or raises again. No command is ever executed twice.
    """

    name: str  # what it is, for people: "TOUCH/1 controller on /dev/ttyUSB0"
    joints: int

    @property
    def sequence(self) -> int:
        """The number that the next command will carry: a journal notes it before the command is sent."""
        ...

    def state(self) -> State:
        """How things stand now. Raises Rebooted once for each restart noticed, then tells the new boot."""
        ...

    def move(self, q: Float[np.ndarray, " joints"], rate: float) -> Float[np.ndarray, " joints"]:
        """Move straight to `q`; where the robot stands afterwards.

        Raises Refused with code EARLY where the wire touches on the way, unless the move began in contact.
        """
        ...

    def search(self, q: Float[np.ndarray, " joints"], rate: float) -> Contact | NoContact:
        """Move straight towards `q` until the wire touches; raises Refused with code ALREADY where it did before."""
        ...

    def latch(self) -> Latch | None:
        """The last latch of this boot, so that a killed program can pick it up.

        None where there is none, or the controller cannot say of which search it is: the touch is then made again.
        """
        ...

    def stop(self) -> None:
        """Stop the robot and return when it stands still; harmless when it does already."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...
