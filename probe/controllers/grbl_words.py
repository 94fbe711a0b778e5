"""What GRBL says and is told, as text: reports, probe results, motions."""

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

AXES = "XYZABCUVW"
TENTHS = 10.0  # [motions/min] below which a feed has a decimal: a lost point makes it ten times faster
REPORT = re.compile(r"<(\w+)(?::\d+)?\|.*>")
PROBE = re.compile(r"\[PRB:([-+.,\d]+):([01])\]")
OFFSETS = re.compile(r"\[(G5[4-9]|G59\.[1-3]|G92|TLO):([-+.,\d]+)\]")
SAID = re.compile(r"ok|error:\d+|ALARM:\d+|\$\d+=[-.\d]+|\[[\x20-\x7e]*\]|<[\x20-\x7e]*>")
ALARMS = {
    "ALARM:1": ("UNHOMED", "hard limit, the position is lost"),
    "ALARM:2": ("LIMIT", "soft limit"),
    "ALARM:3": ("STOPPED", "reset in motion"),
    "ALARM:4": ("ALREADY", ""),
    "ALARM:10": ("ESTOP", ""),
    "ALARM:11": ("UNHOMED", "homing required"),
}
SAME_PLACE = "error:33"  # of grblHAL, for a probing motion to where the robot stands: also when a line came twice
ERRORS = {"error:9": ("UNHOMED", "locked by an alarm"), "error:15": ("LIMIT", ""), "error:79": ("ESTOP", "")}


@dataclass(frozen=True, eq=False)
class Report:
    """A status report."""

    state: str  # Idle, Run, Hold, Alarm, ...
    position: Float[np.ndarray, " joints"]  # machine coordinates [axis units]
    probe: bool  # the pin, as it is now


@dataclass(frozen=True, eq=False)
class Probe:
    """A probe result, as it was printed."""

    text: str
    position: Float[np.ndarray, " joints"]  # machine coordinates [axis units]
    success: bool


def numbers(text: str) -> Float[np.ndarray, " joints"]:
    """Numbers between commas; NaN where one is none."""
    try:
        return np.array([float(part) for part in text.split(",")])
    except ValueError:
        return np.array([np.nan])


def read_report(line: str, joints: int) -> Report | None:
    """A status report with machine positions; None where the line is none, or says less."""
    match = REPORT.fullmatch(line)
    fields = dict(part.partition(":")[::2] for part in line.strip("<>").split("|")[1:])
    position = numbers(fields.get("MPos", ""))
    if match is None or len(position) != joints or not np.isfinite(position).all():
        return None
    return Report(match[1], position, "P" in fields.get("Pn", ""))


def read_probe(line: str, joints: int) -> Probe | None:
    """A probe result; None where the line is none."""
    match = PROBE.fullmatch(line)
    position = numbers(match[1]) if match else np.array([])
    if match is None or len(position) != joints or not np.isfinite(position).all():
        return None
    return Probe(line, position, match[2] == "1")


def read_modes(lines: list[str]) -> list[str]:
    """The words of the parser state that `$G` prints."""
    return " ".join(line.removeprefix("[GC:").rstrip("]") for line in lines if line.startswith("[GC:")).split()


def refusal(line: str) -> tuple[str, str] | None:
    """Code and words of an error or an alarm; None where the line is neither."""
    if line in ALARMS:
        return ALARMS[line][0], " ".join(filter(None, (line, ALARMS[line][1])))
    if re.fullmatch(r"(ALARM|error):\d+", line):
        code, words = ERRORS.get(line, ("NOTREACHED" if line.startswith("ALARM") else "LOST", ""))
        return code, " ".join(filter(None, (line, words)))
    return None


def axis_words(values: Float[np.ndarray, " joints"]) -> str:
    """Axis words with three decimals, as GRBL prints its positions."""
    return "".join(f"{axis}{value:.3f}" for axis, value in zip(AXES, values, strict=False))


def offset(target: Float[np.ndarray, " joints"], more: str = "") -> str:
    """A line that moves nothing: the target as a tool offset [axis units].

    All in one line: next to G43.1 axis words are no motion, and a G that became a C or an F is a second one, an error.
    What a digit leaves of the line when it becomes Ctrl-X, a reset, or begins a comment, is an error too: G4 needs its
    P, and P its G4. From now on positions are relative (G91) and feeds are per motion (G93), for `trigger`.
    """
    return f"G4G43.1G21G91G93F1.{more}{axis_words(target)}P.0"


def trigger(word: str, joints: int, feed: float, speed: int = 0) -> str:
    """A motion to zero, which the tool offset makes the target; `feed` motions a minute, in tenths.

    A GRBL that has started anew just before has forgotten offset and modes: zero is another target there, and the feed
    [axis units/min] so slow that the watch stops the robot as it stops one that a changed digit leads astray.

    Every number is written `.0`: a byte lost is then an error, and a digit changed is off by less than one axis unit.
    Zero is the target for G90 only, the last word: a line that was cut short, whatever comes behind it, leads by zero
    from where the robot stands. The `speed` of the spindle, which is off, is said once more: a G that became an F, or
    a C that became an S, is then a second one, an error. What is left is a guarded motion to the right target at
    another speed.
    """
    fed = f"{feed:.0f}." if feed >= TENTHS else f"{feed:.1f}"
    return f"S{speed}.F{fed}" + "".join(f"{axis}.0" for axis in AXES[:joints]) + f"{word}G90"


def inverse_feed(seconds: float) -> float:
    """The feed of a motion of at least so long [motions/min], with the digits that `trigger` writes."""
    scale = 1 if seconds <= 60 / TENTHS else 10
    return max(np.floor(60 / seconds * scale + 1e-9), 1.0) / scale
