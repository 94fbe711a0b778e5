"""KUKA KRC2 and KRC4: KRL modules (.src, .dat) that search with an interrupt, and the arrays that stay in the .dat.

Sources of the semantics: KUKA KSS operating and programming instructions for system integrators, "Interrupt
programming": INTERRUPT DECL names condition and routine, a rising edge triggers it while it is ON; `$AXIS_INT` holds
the axes at the trigger, BRAKE stops on the path, RESUME gives up the motion and goes on behind the call of the
subprogram in which the interrupt fired, which needs `$ADVANCE=0`; `$MEAS_PULSE[n]` are the fast inputs and must be
FALSE when the interrupt is switched on.

Form of the statements, each in at least two public programs written elsewhere: INTERRUPT DECL ... WHEN ... DO and
INTERRUPT ON (the initialisation that KUKA's own editor writes, style programs of a welding cell), INTERRUPT OFF, BRAKE
and RESUME in the routine of a search with the motion in a subprogram of its own (a search motion in notes on interrupt
numbers, notes on BRAKE with RESUME, notes on LIN_Suchen, a probing template), LIN_REL with a frame, PTP with axes,
`$VEL.CP`, `$TIMER` with `$TIMER_STOP`, `$AXIS_ACT`, WAIT SEC, BAS(#INITMOV,0), HALT. `INTERRUPT DECL` on
`$MEAS_PULSE[1]` stands in one public note (industrialmonitordirect.com, "kuka-meas-pulse-negative-edge"), which says,
too, that the controller stops there while the input is TRUE, and in a public list of system variables. No public
program was found for `$AXIS_INT`, in four searches (`$POS_INT`, its twin, in two: "kuka-interrupt-5-not-triggering",
"kuka-kr-120-interrupt-based"): manual alone. `$POS_INT` would need the controller's own model to become joints, and
`$AXIS_ACT` comes a cycle late, so neither replaces it; every file says so.

Motions of a few mm/s need CP speed, so the search is LIN_REL with constant orientation; joint speeds begin at one
percent.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from identify.model.files import read_text
from identify.model.robot import Robot
from probe.programs.log import CLOSED, HELD, JOINTS, MISSED, NOT_MADE, OPENED, TOUCHED, Entry, Log, fault, header
from probe.programs.options import Options
from probe.programs.page import Instructions
from probe.programs.part import FAILURES, REST, STUCK, Part, joined, percent
from probe.programs.routine import Joints

INTERRUPT = 10
TOUCHES = 500  # in one file: a list of data stays readable
NAMES = ("TC_STAMP", "TC_FIRST", "TC_COUNT", "TC_SPEED")
EXTERNAL = ",".join(f"E{k} 0.0" for k in range(1, 7))

VALUE = re.compile(r"^\s*(?:DECL\s+)?(?:GLOBAL\s+)?(?:INT\s+)?(TC_\w+?)(?:\[(\d+)\])?\s*=\s*(.*?)\s*$", re.IGNORECASE)
AXIS = re.compile(r"\bA([1-6])\s+([+-]?[\d.]+(?:[eE][+-]?\d+)?)")

Values = dict[tuple[str, int], tuple[int, str]]  # line and text, by name and index

INSTRUCTIONS = Instructions(
    title="KUKA KRC2, KRC4",
    prepare=(
        "The touch signal comes in as {input}. A fast measuring input ($MEAS_PULSE) latches at the edge; an ordinary "
        "one ($IN) only every 12 ms, which is 0.06 mm at 5 mm/s.",
        "The robot root of the controller is the base frame of cell.yaml: compare with touchcal check --pendant.",
    ),
    load=("Copy .src and .dat of each file to KRC:\\R1\\Program, as expert; both names must stay together.",),
    save=(
        "After each file of the program has ended: deselect it, then archive it, or copy its .dat from "
        "KRC:\\R1\\Program: TC1.dat after TC1.",
        "touchcal import TC1.dat ... --plan plan.csv --maker kuka -o touches.csv",
    ),
    overwrites="timer 1 and interrupt 10 while it runs",
    unproven="$AXIS_INT and $MEAS_PULSE follow the manual: no two public programs with them were found.",
)


def capacity(options: Options) -> int:
    """Touches in one file; arrays have room for any number."""
    return options.registers or TOUCHES


def write(part: Part) -> dict[str, str]:
    """Source and data list of a part."""
    files = {
        f"{part.name}.src": "\r\n".join(
            [*_main(part), *([] if part.options.rehearsal else [*_touch(part), *_search(part)]), ""]
        )
    }
    if not part.options.rehearsal:
        files[f"{part.name}.dat"] = "\r\n".join([*_data(part), ""])
    return files


def read(paths: Sequence[Path], robot: Robot, stamp: int) -> list[Log]:
    """Logs from .dat files; `stamp` is compared later."""
    return [_log(path, robot) for path in paths]


def _log(path: Path, robot: Robot) -> Log:
    text = read_text(path)
    values: Values = {}
    for line, content in enumerate(text.splitlines(), 1):
        if match := VALUE.match(content):
            values[match[1].upper(), int(match[2] or 0)] = line, match[3]
    if ("TC_STAMP", 0) not in values:
        raise fault(path, 0, "no TC_STAMP in it; give the .dat of the program, archived after it ran")
    line = values["TC_STAMP", 0][0]
    plan, first, count, speed = header((_number(path, values, name, 0) for name in NAMES), path, line)
    entries = tuple(
        Entry(
            first + k - 1,
            int(_number(path, values, "TC_S", k)),
            _axes(path, values, "TC_Q", k, robot),
            _axes(path, values, "TC_R", k, robot),
            values["TC_S", k][0],
        )
        for k in range(1, count + 1)
    )
    return Log(str(path), plan, first, count, speed, entries)


def _text(path: Path, values: Values, name: str, index: int) -> tuple[int, str]:
    if (name, index) not in values:
        place = f"{name}[{index}]" if index else name
        raise fault(path, 0, f"{place} is missing; give the whole .dat of the program, archived after it ran")
    return values[name, index]


def _number(path: Path, values: Values, name: str, index: int) -> float:
    line, text = _text(path, values, name, index)
    try:
        return float(text)
    except ValueError:
        raise fault(path, line, f"{name} is '{text}', expected a number; archive the program again") from None


def _axes(path: Path, values: Values, name: str, index: int, robot: Robot) -> Joints:
    line, text = _text(path, values, name, index)
    axes = {int(match[1]): float(match[2]) for match in AXIS.finditer(text)}
    if len(axes) < JOINTS:
        raise fault(path, line, f"{name}[{index}] is '{text}', expected A1 to A6; archive the program again")
    return robot.from_controller(np.array([axes[k + 1] for k in range(JOINTS)]))


def _axis(counts: Joints) -> str:
    return "{" + joined(counts, 5, ",", "A{number} {value}") + "}"


def _main(part: Part) -> Iterator[str]:
    options = part.options
    frame = f"BASE_DATA[{options.frame}]" if options.frame else "$NULLFRAME"
    yield from ("&ACCESS RVP", "&REL 1", f"&COMMENT touchcal {part.number}/{part.parts}", f"DEF {part.name} ( )")
    yield " INT I"
    yield from (f" ; {remark}" for remark in part.remarks)
    if not options.rehearsal:
        yield f" ; {INSTRUCTIONS.unproven}"
    yield from (";FOLD INI", " BAS (#INITMOV,0)", ";ENDFOLD (INI)", " $ADVANCE=0")
    yield from (f" $TOOL=TOOL_DATA[{options.tool or 1}]", f" $BASE={frame}", " $IPO_MODE=#BASE", " $ORI_TYPE=#CONSTANT")
    if not options.rehearsal:
        yield from (f" {name}={value}" for name, value in zip(NAMES, part.header, strict=True))
        yield from (" TC_FAILED=0", f" FOR I=1 TO {len(part.routines)}", f"  TC_S[I]={NOT_MADE}", " ENDFOR")
    for k, routine in enumerate(part.routines, 1):
        yield f" ; {routine.id} {routine.face}"
        for leg in routine.legs:
            yield from (*_axis_speed(percent(leg.share)), f" PTP {_axis(part.counts(leg.q))}")
        if options.rehearsal:
            continue
        x, y, z = routine.along.round(4) + 0.0
        yield f" TC_A={_axis(part.counts(routine.legs[-1].q))}"
        yield f" TC_D={{X {x:.4f},Y {y:.4f},Z {z:.4f},A 0.0,B 0.0,C 0.0}}"
        yield from _axis_speed(percent(routine.back.share))
        yield f" TC_TOUCH ({k})"
    yield "END"


def _axis_speed(value: int) -> Iterator[str]:
    yield from (" FOR I=1 TO 6", f"  $VEL_AXIS[I]={value}", " ENDFOR")


def _signal(part: Part) -> str:
    return part.options.input or "$MEAS_PULSE[1]"


def _touch(part: Part) -> list[str]:
    """One touch: the input open, the search, the way back, the input open again; the code says how far it came."""
    signal = _signal(part)
    return f"""
DEF TC_TOUCH (N :IN)
 INT N
 TC_N=N
 TC_AWAIT ( )
 IF TC_FREE==FALSE THEN
  TC_S[N]={CLOSED}
  ; the input is closed: free the wire
  HALT
 ELSE
  TC_HIT=FALSE
  INTERRUPT DECL {INTERRUPT} WHEN {signal}==TRUE DO TC_LATCH ( )
  TC_SEARCH ( )
  IF TC_HIT==TRUE THEN
   WAIT SEC {REST:.2f}
   TC_R[N]=$AXIS_ACT
   TC_S[N]={OPENED}
   IF {signal}==TRUE THEN
    TC_S[N]={TOUCHED}
   ENDIF
  ELSE
   TC_S[N]={MISSED}
  ENDIF
  PTP TC_A
  WAIT SEC {part.options.wait:.2f}
  TC_AWAIT ( )
  IF TC_FREE==FALSE THEN
   TC_S[N]={HELD}
   ; the input is closed: free the wire
   HALT
  ENDIF
 ENDIF
 IF TC_S[N]=={TOUCHED} THEN
  TC_FAILED=0
 ELSE
  TC_FAILED=TC_FAILED+1
 ENDIF
 IF TC_FAILED=={FAILURES} THEN
  TC_FAILED=0
  ; no contact: is the jig where the cell says?
  HALT
 ENDIF
END""".splitlines()


def _search(part: Part) -> list[str]:
    """The search, what its interrupt does, and the wait for the input."""
    signal = _signal(part)
    return f"""
DEF TC_SEARCH ( )
 $VEL.CP={part.speed / 1000:.6f}
 INTERRUPT ON {INTERRUPT}
 LIN_REL TC_D
 WAIT SEC 0.0
 INTERRUPT OFF {INTERRUPT}
END

DEF TC_LATCH ( )
 INTERRUPT OFF {INTERRUPT}
 BRAKE
 TC_Q[TC_N]=$AXIS_INT
 TC_HIT=TRUE
 RESUME
END

DEF TC_AWAIT ( )
 $TIMER[1]=0
 $TIMER_STOP[1]=FALSE
 WHILE ({signal}==TRUE) AND ($TIMER[1]<{round(1000 * STUCK)})
  WAIT SEC 0.05
 ENDWHILE
 $TIMER_STOP[1]=TRUE
 TC_FREE={signal}==FALSE
END""".splitlines()


def _data(part: Part) -> Iterator[str]:
    count, zero = len(part.routines), "{" + ",".join(f"A{k} 0.0" for k in range(1, 7))
    yield from ("&ACCESS RVP", "&REL 1", f"DEFDAT {part.name} PUBLIC", *(f"; {remark}" for remark in part.remarks))
    yield from (f"DECL INT {name}={value}" for name, value in zip(NAMES, part.header, strict=True))
    yield from ("DECL INT TC_N=0", "DECL INT TC_FAILED=0", "DECL BOOL TC_HIT=FALSE", "DECL BOOL TC_FREE=FALSE")
    yield from (f"DECL AXIS TC_A={zero}}}", "DECL FRAME TC_D={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}")
    yield from (f"DECL INT TC_S[{count}]", *(f"TC_S[{k}]={NOT_MADE}" for k in range(1, count + 1)))
    for name in ("TC_Q", "TC_R"):
        yield f"DECL E6AXIS {name}[{count}]"
        yield from (f"{name}[{k}]={zero},{EXTERNAL}}}" for k in range(1, count + 1))
    yield "ENDDAT"
