"""What a controller says in TOUCH/1, read from its lines: the greeting, a status, an answer."""

import re
from dataclasses import dataclass

LAST_NUMBER = 65535
# words that a controller of another make says besides come last, and are ignored
GREETING = re.compile(r"0 OK TOUCH/1 boot=(\S+) joints=(\d+) last=(\d+) nonce=(\S+)(?: .*)?")
STATUS = re.compile(r"! ST boot=(\S+) (RUN|IDLE) seq=(\d+)(?: hb=(\d+))? probe=([01]) q=(\S+)(?: .*)?")
ANSWER = re.compile(r"(\d+) (ACK|OK|CONTACT|NOCONTACT|ERR)(?: (.*))?")


@dataclass(frozen=True)
class Status:
    """One `! ST` line."""

    boot: str
    running: bool
    sequence: int
    beat: int  # of the line that it answers; 0 where the controller does not say
    closed: bool
    joints: str


def read_status(line: str) -> Status | None:
    """A status line; None where the line is none."""
    match = STATUS.fullmatch(line)
    if match is None:
        return None
    return Status(match[1], match[2] == "RUN", int(match[3]), int(match[4] or 0), match[5] == "1", match[6])


@dataclass(frozen=True)
class Answer:
    """The last word of the controller on a command."""

    kind: str  # OK, CONTACT or NOCONTACT
    text: str


def following(sequence: int) -> int:
    """The number after this one."""
    return sequence % LAST_NUMBER + 1
