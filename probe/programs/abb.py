r"""ABB IRC5: RAPID modules that search with SearchL, and the text file that they write.

Sources: Technical reference manual RAPID, SearchL: the robot moves linearly; when the signal changes to high the TCP
position of that moment is stored and, with \Stop, the robot stops as quickly as it can; without a change it arrives and
ERR_WHLSEARCH is raised, with the signal high already at the start ERR_SIGSUPSEARCH; after either the path is stored,
the robot moved, the old path cleared and the motion started again before the routine goes on. A string holds 80
characters. Programs read for the form of the statements: an experiment on a virtual controller (module TG_TouchProbe,
with the same recovery and the stored point on the face), a brick-laying module that handles both errors, the touch
sensing of a gantry, the calibration of a cell (ERR_WHLSEARCH and ERR_SIGSUPSEARCH told apart). The robot searches along
a straight line because RAPID has no search in joint space; the joints are those that the controller itself finds for
the stored point (CalcJointT).
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

from identify.model.files import read_text
from identify.model.robot import Robot
from probe.programs.log import CLOSED, HELD, MISSED, OPENED, TOUCHED, Log, read_lines
from probe.programs.options import Options
from probe.programs.page import Instructions
from probe.programs.part import FAILURES, REST, STUCK, Part, joined
from probe.programs.routine import Joints

TOUCHES = 200  # in one module
NONE = "[9E9,9E9,9E9,9E9,9E9,9E9]"  # external axes that there are not
TOOL = "tool0"

INSTRUCTIONS = Instructions(
    title="ABB IRC5",
    prepare=(
        "A digital input named {input} reads 1 while the wire touches.",
        "The tool is the torch, so that searches go at the speed of the tip: --tool names its tooldata.",
    ),
    load=(
        "Copy the .mod files to the controller; Program Editor > Modules > Load Module; start TC1 by PP to Routine.",
    ),
    save=(
        "After each file of the program has ended: copy tc1.txt from HOME: (TC1 writes tc1.txt, TC2 writes tc2.txt).",
        "touchcal import tc1.txt ... --plan plan.csv --maker abb -o touches.csv",
    ),
    overwrites="the files tc1.txt, ... in HOME:",
)


def capacity(options: Options) -> int:
    """Touches in one module; nothing but its size limits them."""
    return options.registers or TOUCHES


def write(part: Part) -> dict[str, str]:
    """The module of a part."""
    return {f"{part.name}.mod": "\n".join([*_module(part), ""])}


def read(paths: Sequence[Path], robot: Robot, stamp: int) -> list[Log]:
    """Logs from text files; `stamp` is compared later."""
    return [read_lines(path, read_text(path).splitlines(), robot.from_controller) for path in paths]


def _joints(counts: Joints) -> str:
    return f"[[{joined(counts, 5)}],{NONE}]"


def _module(part: Part) -> Iterator[str]:
    options = part.options
    tool = options.tool or TOOL
    yield from (f"MODULE {part.name}", *(f"  ! {remark}" for remark in part.remarks))
    yield f"  LOCAL CONST speeddata vMove:=[{options.move_speed:g},500,5000,1000];"
    yield f"  LOCAL CONST speeddata vBack:=[{options.retract_speed:g},500,5000,1000];"
    if not options.rehearsal:
        yield f"  LOCAL CONST speeddata vSearch:=[{part.speed:g},500,5000,1000];"
        yield from ("  LOCAL VAR iodev dLog;", "  LOCAL VAR robtarget pStart;", "  LOCAL VAR robtarget pFound;")
        yield from ("  LOCAL VAR num nCode:=0;", "  LOCAL VAR num nFailed:=0;")
    yield from ("", f"  PROC {part.name}()")
    if not options.rehearsal:
        stamp, first, count, speed = part.header
        yield f'    Open "HOME:" \\File:="{_file(part)}", dLog \\Write;'
        yield f'    Write dLog, "touchcal {stamp} {first} {count} {speed}";'
        yield from ("    Close dLog;", "    nFailed:=0;", "    ConfL \\Off;")
    for routine in part.routines:
        yield f"    ! {routine.id} {routine.face}"
        for leg in routine.legs:
            yield f"    MoveAbsJ {_joints(part.counts(leg.q))} \\NoEOffs, vMove, fine, {tool};"
        if not options.rehearsal:
            yield f"    Touch {routine.number}, {_joints(part.counts(routine.end))};"
    yield "  ENDPROC"
    yield from () if options.rehearsal else (*_touch(part), *_search(part))
    yield "ENDMODULE"


def _file(part: Part) -> str:
    return f"{part.name.lower()}.txt"


def _names(part: Part) -> tuple[str, str]:
    """The touch input, and the tool in its work object."""
    options = part.options
    return options.input or "diTouch", f"{options.tool or TOOL} \\WObj:={options.frame or 'wobj0'}"


def _touch(part: Part) -> list[str]:
    """One touch: the input open, the search, the way back, the input open again; the code says how far it came."""
    signal, where = _names(part)
    return f"""
  LOCAL PROC Touch(num n, jointtarget jEnd)
    VAR jointtarget jFound;
    VAR jointtarget jRest;
    VAR bool late:=FALSE;
    jFound:=CJointT();
    jRest:=jFound;
    nCode:={CLOSED};
    WaitDI {signal}, 0 \\MaxTime:={STUCK:g} \\TimeFlag:=late;
    IF NOT late THEN
      pStart:=CRobT(\\Tool:={where});
      Seek CalcRobT(jEnd, {where});
      IF nCode={TOUCHED} THEN
        WaitTime {REST:g};
        jRest:=CJointT();
        jFound:=CalcJointT(pFound, {where});
        IF DInput({signal})=0 nCode:={OPENED};
        MoveL pStart, vBack, fine, {where};
      ENDIF
      WaitTime {part.options.wait:g};
      WaitDI {signal}, 0 \\MaxTime:={STUCK:g} \\TimeFlag:=late;
      IF late nCode:={HELD};
    ENDIF
    LogTouch n, jFound, jRest;
    IF nCode={TOUCHED} THEN
      nFailed:=0;
    ELSE
      nFailed:=nFailed+1;
    ENDIF
    IF late THEN
      TPWrite "touchcal: the input is closed; free the wire";
      Stop;
    ENDIF
    IF nFailed={FAILURES} THEN
      nFailed:=0;
      TPWrite "touchcal: no contact; is the jig where the cell says?";
      Stop;
    ENDIF
  ENDPROC""".splitlines()


def _search(part: Part) -> list[str]:
    """The search with what it raises, and the lines of the log."""
    signal, where = _names(part)
    return f"""
  LOCAL PROC Seek(robtarget pTo)
    nCode:={MISSED};
    SearchL \\Stop, {signal}, pFound, pTo, vSearch, {where};
    nCode:={TOUCHED};
  ERROR
    IF ERRNO=ERR_WHLSEARCH OR ERRNO=ERR_SIGSUPSEARCH THEN
      IF ERRNO=ERR_SIGSUPSEARCH nCode:={CLOSED};
      StorePath;
      MoveL pStart, vBack, fine, {where};
      RestoPath;
      ClearPath;
      StartMove;
      RETURN;
    ELSE
      RAISE;
    ENDIF
  ENDPROC

  LOCAL PROC LogTouch(num n, jointtarget jFound, jointtarget jRest)
    Open "HOME:" \\File:="{_file(part)}", dLog \\Append;
    Write dLog, "t "+NumToStr(n,0)+" "+NumToStr(nCode,0)+AsText(jFound.robax);
    Write dLog, "r "+NumToStr(n,0)+AsText(jRest.robax);
    Close dLog;
  ENDPROC

  LOCAL FUNC string AsText(robjoint r)
    RETURN " "+NumToStr(r.rax_1,5)+" "+NumToStr(r.rax_2,5)+" "+NumToStr(r.rax_3,5)
      +" "+NumToStr(r.rax_4,5)+" "+NumToStr(r.rax_5,5)+" "+NumToStr(r.rax_6,5);
  ENDFUNC""".splitlines()
