"""FANUC R-30iA and R-30iB: TP programs (.LS) that search with the high-speed skip, and the registers they leave.

Sources: `SKIP CONDITION` and `Skip,LBL[n],PR[m]=JPOS`: where the condition becomes true the motion stops, the position
of that moment is stored, and the next line runs; where it never does, the robot arrives and the program jumps to the
label (FANUC Handling Tool operator's manual, skip and high-speed skip instruction; a public explanation with examples
stands at onerobotics.com, "Refactoring Skip Conditions"). Programs read for the form of the statements: ros_movesm.ls
of gavanderhoorn/fanuc_driver_exp (joint motion with a skip), the tests of kobbled/tp_plus (`Skip,LBL[100],PR[1]=LPOS`),
a depalletizing cell (`SKIP CONDITION DI[8]=ON` before a search), a cell for panels (`SKIP CONDITION` on registers,
`PR[14]=JPOS`). posreg.va shows three decimals of a degree, numreg.va six of a real number (public readers of both
files, and backups that they quote); `R[n]=PR[m,k]` hands over an element of a position register. So the latched joints
go into numeric registers, too: there they are as fine as a real of 32 bits holds them.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from identify.model.files import InputError, read_text
from identify.model.robot import Robot
from probe.programs.log import CLOSED, HEADER, HELD, JOINTS, MISSED, NOT_MADE, OPENED, TOUCHED, Entry, Log, fault
from probe.programs.options import Options
from probe.programs.page import Instructions
from probe.programs.part import FAILURES, REST, STUCK, Part, folded, percent
from probe.programs.registers import Elements, Numbers
from probe.programs.routine import Joints, Routine

SCRATCH = 3  # position registers: approach, end of the search, latch
NUMBERS = 10  # registers before those of the touches: the header, then index, latch, seconds, rest, failures, percent
EACH = 1 + JOINTS  # numeric registers of a touch: the code, then the latched joints
ALIKE = 0.0015  # [deg] by which the latched joints in both files may differ
POSITION_REGISTERS, NUMERIC_REGISTERS = 100, 200  # of a controller as it is delivered
COMMENT = 32  # characters of a remark
LONGEST = 3200.0  # [s] of a motion

ELEMENT = re.compile(r"^\s*\[(?:1,)?\s*(\d+)\]\s*=\s*(.*)$")
JOINT = re.compile(r"J(\d)\s*[=:]\s*([+-]?[\d.]+)\s*deg")

INSTRUCTIONS = Instructions(
    title="FANUC R-30iA, R-30iB",
    prepare=(
        "The high-speed skip is installed: the menu of motion options offers Skip,LBL[],PR[]=JPOS.",
        "The touch signal comes in as {input}: see it change on the I/O page when the wire touches the jig by hand.",
    ),
    load=("Copy all .LS files to a USB stick or by FTP, then FILE > LOAD; the ASCII Upload option reads .LS files.",),
    save=(
        "After each file of the program has ended: FILE > BACKUP > Position registers and Numeric registers, or copy "
        "posreg.va and numreg.va from MD: by FTP. Do this before the next file runs, and name them by the file: "
        "posreg1.va and numreg1.va after TC1.",
        "touchcal import posreg1.va numreg1.va ... --plan plan.csv --maker fanuc -o touches.csv",
    ),
    overwrites="PR[{first}] to PR[{last}], R[{first}] to R[{numbers}] and $WAITTMOUT",
)


def capacity(options: Options) -> int:
    """Touches in one file: two position registers and seven numeric ones each."""
    numbers = (options.registers or NUMERIC_REGISTERS) - options.first + 1 - NUMBERS
    return min((POSITION_REGISTERS - options.first + 1 - SCRATCH) // 2, numbers // EACH)


def write(part: Part) -> dict[str, str]:
    """The program of a part, and the subprogram that makes one touch."""
    lines, positions = list(_main(part)), [q for routine in part.routines for q in _postures(routine, part)]
    files = {f"{part.name}.LS": _program(part, part.name, lines, positions)}
    if not part.options.rehearsal:
        files["TCTOUCH.LS"] = _program(part, "TCTOUCH", _touch(part), [])
    return files


def read(paths: Sequence[Path], robot: Robot, stamp: int) -> list[Log]:
    """Logs of the plan with a stamp, from pairs of posreg.va and numreg.va in the order given."""
    registers: dict[str, list[tuple[Path, Elements]]] = {"POSREG": [], "NUMREG": []}
    for path in paths:
        text = read_text(path)
        kinds = [kind for kind in registers if f"[*{kind}*]" in text]
        if not kinds:
            raise fault(
                path, 1, "no [*POSREG*] and no [*NUMREG*] in it; save posreg.va and numreg.va from the FILE menu"
            )
        for kind in kinds:
            registers[kind].append((path, _elements(text, kind)))
    positions, numbers = registers["POSREG"], registers["NUMREG"]
    if len(positions) != len(numbers):
        text = f"{len(positions)} posreg.va and {len(numbers)} numreg.va are given; give both of every run, in pairs"
        raise InputError(text)
    return [_log(*a, *b, robot, stamp) for a, b in zip(positions, numbers, strict=True)]


def _log(path: Path, positions: Elements, number_path: Path, elements: Elements, robot: Robot, stamp: int) -> Log:
    numbers = Numbers(number_path, elements, "R[{0}]", "numreg.va")
    first, number, count, speed = numbers.log(stamp)
    entries = []
    for k in range(count):
        at, place = first + NUMBERS + EACH * k, first + SCRATCH + 2 * k
        code = int(numbers[at])
        latch, rest = (_joints(path, positions, place + i) for i in (0, 1))
        if code in (TOUCHED, OPENED, HELD) and not np.isnan(latch).any():
            latch = _finer(latch, np.array([numbers[at + j] for j in range(1, EACH)]), path, positions[place][0])
        latch, rest = (robot.from_controller(counts) for counts in (latch, rest))
        entries.append(Entry(number + k, code, latch, rest, numbers.line(at)))
    return Log(str(path), stamp, number, count, speed, tuple(entries))


def _finer(coarse: Joints, fine: Joints, path: Path, line: int) -> Joints:
    """The latched joints as numreg.va holds them; raises InputError if posreg.va shows others."""
    apart = np.abs(coarse - fine).max()
    if apart > ALIKE:
        text = f"the latched joints differ by {apart:.3f} degrees from those in numreg.va; save both files of one run"
        raise fault(path, line, text)
    return fine


def _elements(text: str, kind: str) -> Elements:
    """Elements of an array of a .va file: line and text of each, by its index."""
    elements: Elements = {}
    inside, index = False, 0
    for line, content in enumerate(text.splitlines(), 1):
        if content.startswith("[*"):
            inside = content.startswith(f"[*{kind}*]$" + kind)
            index = 0
        elif inside and (match := ELEMENT.match(content)):
            index = int(match[1])
            elements[index] = line, match[2]
        elif inside and index and not re.match(r"^\s*\[", content):
            elements[index] = elements[index][0], f"{elements[index][1]} {content}"
        else:
            index = 0
    return elements


def _joints(path: Path, positions: Elements, index: int) -> Joints:
    line, text = positions.get(index, (0, ""))
    values = {int(match[1]): float(match[2]) for match in JOINT.finditer(text)}
    if sorted(values) == list(range(1, JOINTS + 1)):
        return np.array([values[k + 1] for k in range(JOINTS)])
    if "Uninitialized" in text or not text:
        return np.full(JOINTS, np.nan)
    raise fault(path, line, f"PR[{index}] does not hold joints; the program stores JPOS, was it changed to LPOS?")


def _postures(routine: Routine, part: Part) -> list[Joints]:
    return [
        part.counts(q) for q in (*(leg.q for leg in routine.legs), *([] if part.options.rehearsal else [routine.end]))
    ]


def _main(part: Part) -> Iterator[str]:
    options, R = part.options, part.options.first
    yield from (f"!{remark}" for text in part.remarks for remark in folded(text, COMMENT))
    yield f"UFRAME_NUM={options.frame or 0}"
    yield f"UTOOL_NUM={options.tool or 1}"
    if not options.rehearsal:
        for k, (name, value) in enumerate(zip(HEADER, part.header, strict=True)):
            yield f"R[{R + k}:{name}]={value}"
        yield f"R[{R + 8}:failed]=0"
        yield from (f"R[{R + NUMBERS + EACH * k}]={NOT_MADE}" for k in range(len(part.routines)))
    position = 0
    for k, routine in enumerate(part.routines):
        yield f"!{routine.id} {routine.face}"[: COMMENT + 1]
        for leg in routine.legs:
            position += 1
            yield f"J P[{position}] {percent(leg.share)}% FINE"
        if options.rehearsal:
            continue
        position += 1
        yield f"PR[{R}:approach]=P[{position - 1}]"
        yield f"PR[{R + 1}:end]=P[{position}]"
        yield f"R[{R + 4}:code]={R + NUMBERS + EACH * k}"
        yield f"R[{R + 5}:latch]={R + SCRATCH + 2 * k}"
        yield f"R[{R + 6}:seconds]={min(routine.seconds, LONGEST):.1f}"
        yield f"R[{R + 9}:back]={percent(routine.back.share)}"
        yield "CALL TCTOUCH"
    yield "END"


def _touch(part: Part) -> list[str]:
    """One touch: the input open, the search, the way back, the input open again; the code says how far it came."""
    R, signal, wait = part.options.first, part.options.input or "DI[1]", f"{part.options.wait:.2f}"
    code, failed = f"R[R[{R + 4}]]", f"R[{R + 8}]"
    digits = "\n".join(f"R[{R + 7}]=R[{R + 4}]+{k}\nR[R[{R + 7}]]=PR[{R + 2},{k}]" for k in range(1, JOINTS + 1))
    remarks = "\n".join(f"!{line}" for text in part.remarks[2:] for line in folded(text, COMMENT))
    return f"""{remarks}
$WAITTMOUT={round(100 * STUCK)}
WAIT {signal}=OFF TIMEOUT,LBL[3]
SKIP CONDITION {signal}=ON
J PR[{R + 1}] R[{R + 6}]sec FINE Skip,LBL[2],PR[{R + 2}]=JPOS
!Contact
WAIT {REST:.2f}(sec)
PR[R[{R + 5}]]=PR[{R + 2}]
{digits}
R[{R + 7}]=R[{R + 5}]+1
PR[R[{R + 7}]]=JPOS
{code}={OPENED}
IF {signal}=OFF,JMP LBL[1]
{code}={TOUCHED}
LBL[1]
J PR[{R}] R[{R + 9}]% FINE
WAIT {wait}(sec)
$WAITTMOUT={round(100 * STUCK)}
WAIT {signal}=OFF TIMEOUT,LBL[4]
IF {code}<>{TOUCHED},JMP LBL[5]
{failed}=0
END
LBL[2]
!Nothing met
{code}={MISSED}
J PR[{R}] R[{R + 9}]% FINE
WAIT {wait}(sec)
LBL[5]
{failed}={failed}+1
IF {failed}<{FAILURES},JMP LBL[6]
{failed}=0
MESSAGE[TC: NO CONTACT, CHECK JIG]
PAUSE
LBL[6]
END
LBL[3]
{code}={CLOSED}
MESSAGE[TC: INPUT CLOSED, FREE WIRE]
PAUSE
END
LBL[4]
{code}={HELD}
MESSAGE[TC: INPUT CLOSED, FREE WIRE]
PAUSE
END""".splitlines()


def _program(part: Part, name: str, lines: Sequence[str], positions: Sequence[Joints]) -> str:
    head = [
        f"/PROG  {name}",
        "/ATTR",
        "OWNER\t\t= MNEDITOR;",
        f'COMMENT\t\t= "touchcal {part.number}/{part.parts}";',
        "PROG_SIZE\t= 0;",
        "CREATE\t\t= DATE 26-01-01  TIME 00:00:00;",
        "MODIFIED\t= DATE 26-01-01  TIME 00:00:00;",
        "FILE_NAME\t= ;",
        "VERSION\t\t= 0;",
        f"LINE_COUNT\t= {len(lines)};",
        "MEMORY_SIZE\t= 0;",
        "PROTECT\t\t= READ_WRITE;",
        "TCD:  STACK_SIZE\t= 0,",
        "      TASK_PRIORITY\t= 50,",
        "      TIME_SLICE\t= 0,",
        "      BUSY_LAMP_OFF\t= 0,",
        "      ABORT_REQUEST\t= 0,",
        "      PAUSE_REQUEST\t= 0;",
        "DEFAULT_GROUP\t= 1,*,*,*,*;",
        "CONTROL_CODE\t= 00000000 00000000;",
        "/MN",
    ]
    body = [f"{k:4d}:{'' if line.startswith('J ') else '  '}{line} ;" for k, line in enumerate(lines, 1)]
    tail = ["/POS"]
    for k, counts in enumerate(positions, 1):
        values = [f"J{j + 1}= {value + 0.0:11.5f} deg" for j, value in enumerate(counts.round(5))]
        tail += [f"P[{k}]{{", "   GP1:", f"\tUF : {part.options.frame or 0}, UT : {part.options.tool or 1},\t"]
        tail += ["\t" + ",\t".join(values[:3]) + ",", "\t" + ",\t".join(values[3:]), "};"]
    return "\n".join([*head, *body, *tail, "/END", ""])
