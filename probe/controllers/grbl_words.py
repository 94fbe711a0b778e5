"""What GRBL says and is told, as text: reports, probe results, motions."""

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

AXES = "XYZABCUVW"
REPORT = re.compile(r"<(\w+)(?::\d+)?\|.*>")
PROBE = re.compile(r"\[PRB:([-+.,\d]+):([01])\]")
OFFSETS = re.compile(r"\[(G5[4-9]|G59\.[1-3]|G92|TLO):([-+.,\d]+)\]")
ALARMS = {
    "ALARM:1": ("UNHOMED", "hard limit, the position is lost"),
    "ALARM:2": ("LIMIT", "soft limit"),
    "ALARM:3": ("STOPPED", "reset in motion"),
    "ALARM:4": ("ALREADY", ""),
    "ALARM:10": ("ESTOP", ""),
    "ALARM:11": ("UNHOMED", "homing required"),
}
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
    found = REPORT.fullmatch(line)
    fields = dict(part.partition(":")[::2] for part in line.strip("<>").split("|")[1:])
    position = numbers(fields.get("MPos", ""))
    if found is None or len(position) != joints or not np.isfinite(position).all():
        return None
    return Report(found[1], position, "P" in fields.get("Pn", ""))


def read_probe(line: str, joints: int) -> Probe | None:
    """A probe result; None where the line is none."""
    found = PROBE.fullmatch(line)
    position = numbers(found[1]) if found else np.array([])
    if found is None or len(position) != joints or not np.isfinite(position).all():
        return None
    return Probe(line, position, found[2] == "1")


def refusal(line: str) -> tuple[str, str] | None:
    """Code and words of an error or an alarm; None where the line is neither."""
    if line in ALARMS:
        return ALARMS[line][0], " ".join(filter(None, (line, ALARMS[line][1])))
    if re.fullmatch(r"(ALARM|error):\d+", line):
        code, words = ERRORS.get(line, ("NOTREACHED" if line.startswith("ALARM") else "LOST", ""))
        return code, " ".join(filter(None, (line, words)))
    return None


def motion(word: str, target: Float[np.ndarray, " joints"], seconds: float) -> str:
    """A motion to machine coordinates that lasts so long, in inverse time: no doubt which axes a feed counts."""
    places = "".join(f" {axis}{value:.4f}" for axis, value in zip(AXES, target, strict=False))
    return f"G90 G93 {word}{places} F{60.0 / seconds:.4f}"
