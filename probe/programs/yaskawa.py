"""Yaskawa DX200 and YRC1000: INFORM jobs (.JBI) that search with SRCH, and the variables they leave.

Sources: INFORM language manual, SRCH: a motion with `SRCH RIN#(n)=ON` watches a direct input and stops where it goes
on; the pulses of that moment are kept in `$PX002`, and `$B002` says whether anything was found; `GETS` reads system
variables, `$PX000` are the pulses now. Job data format (easymanua.ls, DX100 and NX100, "Job Data Format"): `///PULSE`,
`C00000=` positions of the job, `P00000=` position variables. Texts read for the form of the statements: `touchsense` of
the DX200 client of rpiRobotics (`MOVL C00000 V=.. SRCH RIN#(3)=ON DIS=..`); a job that searches, quoted and mended on
industrialmonitordirect.com, "yaskawa-robot-search-function-inconsistent-measurement-fix" (`MOVL LP004 V=20.0 SRCH
RIN#(2)=ON T=0.50 DIS=0.05`, then `GETS PX090` of `$PX002`); a program that writes jobs (`GETS PX000 $PX000`); public
notes on INFORM for the YRC1000 (`GETS PX002 $PX002` after a search, `GETS B000 $B002`, `JUMP *label IF IN#(1)=OFF`,
`WAIT IN#(12)=ON T=..`, `TIMER T=..`). So `SRCH RIN` and `$PX002` stand in two places each; `$B002` in manual and notes
alone: what the input reads after a search would do the same, were it not for a wire that bounces. SRCH belongs to
MOVL: the tip goes straight. VAR.DAT holds position variables one a line:
`"UNUSED"` or `"PULSE"`, six numbers (type, frame, configuration, tool) and the pulses (backups of a GP88 and an SDA20D,
and a public reader of such files). What is not there is read from a job that was saved with them.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from identify.model.files import InputError, read_text
from identify.model.robot import Robot
from probe.programs.log import CLOSED, HELD, JOINTS, MISSED, NOT_MADE, OPENED, TOUCHED, Entry, Log, fault
from probe.programs.options import Options
from probe.programs.page import Instructions
from probe.programs.part import FAILURES, REST, STUCK, Part, folded, joined
from probe.programs.registers import Elements, Numbers
from probe.programs.routine import Joints

POSITION_VARIABLES, BYTE_VARIABLES = 128, 100  # of a controller as it is delivered
CODES = 10  # byte variables before the codes: flags and counters
COMMENT = 31  # characters of a remark
SLOWEST = 0.1  # [mm/s]

INPUT = re.compile(r"(RIN#\(\d+\)),(IN#\(\d+\))")
UNUSED, SLOT = '"UNUSED"', re.compile(r'^"PULSE"(?:[^,]*,){6}(.+)$')  # a position variable in VAR.DAT
PLACE = re.compile(r"^\s*P(?:X)?(\d+)\s*=\s*(.+?)\s*$")

INSTRUCTIONS = Instructions(
    title="Yaskawa DX200, YRC1000",
    prepare=(
        "The touch signal comes in twice, as {input}: the direct input (RIN) is what the search latches with, the "
        "general input (IN) is what the job asks for otherwise.",
        "The search function (SRCH) is enabled, and cell.yaml says the pulses of a degree (joints: pulses_per_deg).",
        "The controller knows whole pulses, 0.0005 to 0.002 degrees. On a virtual arm that moved the contacts by "
        "0.0025 mm (RMS); the tip was as accurate as after a live run whose joints are not rounded, within 1 %.",
    ),
    load=("Copy all .JBI files to a USB stick, then EX. MEMORY > LOAD > JOB; load TCOPEN and TCFAIL first.",),
    save=(
        "After each file of the program has ended: EX. MEMORY > SAVE > DATA > VARIABLE, which writes VAR.DAT. Do this "
        "before the next file runs, and name it by the file: VAR1.DAT after TC1.",
        "If touchcal cannot read the positions in VAR.DAT: save a job that names the position variables as .JBI, and "
        "give it behind VAR.DAT.",
        "touchcal import VAR1.DAT ... --plan plan.csv --maker yaskawa -o touches.csv",
    ),
    overwrites="P, B and D variables from {first} on, counted from 1: P{zero:03d}, B{zero:03d} and D{zero:03d}",
    unproven="$B002 follows the manual: no two public jobs with it were found.",
)


def capacity(options: Options) -> int:
    """Touches in one job: two position variables and a byte variable each."""
    rest = (options.registers or POSITION_VARIABLES) - options.first + 1
    return min(rest // 2, BYTE_VARIABLES - options.first + 1 - CODES)


def write(part: Part) -> dict[str, str]:
    """The job of a part, and the jobs that it calls."""
    files = {part.name: _job(part, part.name, list(_main(part)), list(_positions(part)))}
    if not part.options.rehearsal:
        files |= {
            name: _job(part, name, lines, []) for name, lines in (("TCOPEN", _open(part)), ("TCFAIL", _failed(part)))
        }
    return {f"{name}.JBI": text for name, text in files.items()}


def read(paths: Sequence[Path], robot: Robot, stamp: int) -> list[Log]:
    """Logs from files VAR.DAT, each followed by jobs (.JBI) that hold position variables where it has none to read."""
    logs: list[tuple[Path, dict[str, Elements]]] = []
    for path in paths:
        text = read_text(path)
        if re.search(r"^///B\s*$", text, re.MULTILINE):
            logs.append((path, _variables(text)))
        elif not logs:
            raise fault(
                path, 1, "no section ///B in it; give VAR.DAT first, and jobs with position variables behind it"
            )
        else:
            if "///PULSE" not in text:
                raise fault(path, 0, "no positions as pulses in it; save a job that names the position variables")
            logs[-1][1]["P"] |= _places(text.splitlines())
    if not logs:
        raise InputError("no VAR.DAT is given")
    return [_log(path, variables, robot, stamp) for path, variables in logs]


def _log(path: Path, variables: dict[str, Elements], robot: Robot, stamp: int) -> Log:
    codes = Numbers(path, variables["B"], "B{0:03d}", "VAR.DAT")
    at, first, count, speed = Numbers(path, variables["D"], "D{0}", "VAR.DAT").log(stamp)
    entries = []
    for k in range(count):
        code = int(codes[at + CODES + k])
        latch, rest = (_pulses(path, variables["P"], at + 2 * k + i, robot, code) for i in (0, 1))
        entries.append(Entry(first + k, code, latch, rest, codes.line(at + CODES + k)))
    return Log(str(path), stamp, first, count, speed, tuple(entries))


def _variables(text: str) -> dict[str, Elements]:
    """Elements by kind and index: B and D in rows of numbers, P one a line; an unused one is left out."""
    elements: dict[str, Elements] = {"B": {}, "D": {}, "P": {}}
    kind, slots = "", 0
    for line, content in enumerate(text.splitlines(), 1):
        if content.startswith("///"):
            kind = content[3:].strip()
        elif kind == "P" and content.strip():
            if content.strip() != UNUSED:
                pulses = SLOT.match(content.strip())
                elements["P"][slots] = line, pulses[1] if pulses else content
            slots += 1
        elif kind in elements:
            for word in filter(None, (word.strip() for word in content.split(","))):
                elements[kind][len(elements[kind])] = line, word
    return elements


def _places(lines: Sequence[str]) -> Elements:
    """Position variables that are named."""
    matches = ((line, PLACE.match(content)) for line, content in enumerate(lines, 1))
    return {int(match[1]): (line, match[2]) for line, match in matches if match}


def _pulses(path: Path, places: Elements, index: int, robot: Robot, code: int) -> Joints:
    if index not in places:
        if code in (TOUCHED, OPENED):
            text = f"P{index:03d} is not in it; load a job that names it, save that as .JBI, and give it behind VAR.DAT"
            raise fault(path, 0, text)
        return np.full(JOINTS, np.nan)
    line, text = places[index]
    try:
        pulses = np.array([int(word) for word in text.split(",")[:JOINTS]])
        if len(pulses) < JOINTS:
            raise ValueError
    except ValueError:
        raise fault(
            path, line, f"P{index:03d} is '{text}', expected {JOINTS} whole pulses; is it no PULSE type?"
        ) from None
    return robot.from_pulses(pulses)


def _signals(part: Part) -> tuple[str, str]:
    """The direct input that a search watches, and the general input that is asked otherwise."""
    match = INPUT.fullmatch(part.options.input or "RIN#(1),IN#(1)")
    assert match is not None, "the notation is checked before"
    return match[1], match[2]


def _positions(part: Part) -> Iterator[Joints]:
    for routine in part.routines:
        yield from (part.robot.to_pulses(leg.q) for leg in routine.legs)
        if not part.options.rehearsal:
            yield part.robot.to_pulses(routine.end)


def _main(part: Part) -> Iterator[str]:
    options, V = part.options, part.options.first - 1
    if not options.rehearsal:
        yield from (f"SET D{V + k:03d} {value}" for k, value in enumerate(part.header))
        yield f"SET B{V + 2:03d} 0"
        yield from (f"SET B{V + CODES + k:03d} {NOT_MADE}" for k in range(len(part.routines)))
    position = 0
    for k, routine in enumerate(part.routines):
        yield f"'{routine.id} {routine.face}"[: COMMENT + 1]
        for leg in routine.legs:
            yield f"MOVJ C{position:05d} VJ={max(100 * leg.share, 0.01):.2f}"
            position += 1
        if not options.rehearsal:
            yield from _touch(part, k, position)
            position += 1


def _touch(part: Part, k: int, end: int) -> list[str]:
    """One touch: the input open, the search, the way back, the input open again; the code says how far it came.

    `end` is the position behind that of the approach.
    """
    V, (direct, level) = part.options.first - 1, _signals(part)
    closed, contact, failed, code = (f"B{V + number:03d}" for number in (0, 1, 2, CODES + k))
    latch, rest = (f"PX{V + 2 * k + i:03d}" for i in (0, 1))
    speed, length = max(part.speed, SLOWEST), np.linalg.norm(part.routines[k].along)
    return f"""CALL JOB:TCOPEN
SET {code} {CLOSED}
JUMP *E{k} IF {closed}=1
MOVL C{end:05d} V={speed:.1f} SRCH {direct}=ON DIS={length:.1f}
GETS {contact} $B002
SET {code} {MISSED}
JUMP *R{k} IF {contact}=0
GETS {latch} $PX002
TIMER T={REST:.2f}
GETS {rest} $PX000
SET {code} {OPENED}
JUMP *R{k} IF {level}=OFF
SET {code} {TOUCHED}
*R{k}
MOVL C{end - 1:05d} V={part.options.retract_speed:.1f}
TIMER T={part.options.wait:.2f}
CALL JOB:TCOPEN
JUMP *S{k} IF {closed}=0
SET {code} {HELD}
*E{k}
MSG "TC: INPUT CLOSED, FREE THE WIRE"
PAUSE
*S{k}
JUMP *G{k} IF {code}={TOUCHED}
CALL JOB:TCFAIL
JUMP *N{k}
*G{k}
SET {failed} 0
*N{k}""".splitlines()


def _open(part: Part) -> list[str]:
    """B000 is 0 once the input is open, 1 if it stays closed."""
    V, level = part.options.first - 1, _signals(part)[1]
    wait = f"WAIT {level}=OFF T={STUCK:.2f}"
    return [f"SET B{V:03d} 0", wait, f"JUMP *OPEN IF {level}=OFF", f"SET B{V:03d} 1", "*OPEN"]


def _failed(part: Part) -> list[str]:
    """Counts touches in a row without a contact, and stops at the third."""
    failed = f"B{part.options.first + 1:03d}"
    message = 'MSG "TC: NO CONTACT, CHECK THE JIG"'
    return [f"INC {failed}", f"JUMP *ON IF {failed}<{FAILURES}", f"SET {failed} 0", message, "PAUSE", "*ON"]


def _job(part: Part, name: str, lines: Sequence[str], positions: Sequence[Joints]) -> str:
    head = ["/JOB", f"//NAME {name}", "//POS", f"///NPOS {len(positions)},0,0,0,0,0"]
    if positions:
        head += [f"///TOOL {part.options.tool or 0}", "///POSTYPE PULSE", "///PULSE"]
        head += [f"C{k:05d}=" + joined(pulses, 0) for k, pulses in enumerate(positions)]
    head += ["//INST", "///DATE 2026/01/01 00:00", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    unproven = [] if part.options.rehearsal else [INSTRUCTIONS.unproven]
    remarks = [f"'{line}" for remark in (*part.remarks, *unproven) for line in folded(remark, COMMENT)]
    return "\r\n".join([*head, *remarks, *lines, "END", ""])
