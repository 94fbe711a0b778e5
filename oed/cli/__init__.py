"""The command line: a command is a typed function whose docstring is its help; it reads files and writes files.

In the order in which data walks through:

    options     options that several commands share, and how results are printed
    screen      what a person sees: help, progress, touches as they are made
    demo        the whole loop on the embedded virtual robot
    init        a commented cell folder to start from, and JSON schemas of its files
    jig         a jig proposed from the mesh of a part
    check       the cell validated and compared with the pendant
    plan        touches chosen
    plans       plans of several kinds of measurements
    run         touches made
    program     touches as a program in the controller's own language
    import_log  touches from what such a program logged
    campaign    touches made, identified and planned by turns
    virtual     a virtual cell behind a port
    identify    parameters from touches
    verify      errors at touches that the fit has not seen
    compensate  corrected joints and poses
    fix         corrected robot programs
    export      the robot for other tools
    locate      the pose of a workpiece
    health      whether the robot has changed
    report      the page of a calibration
    study       questions answered with numbers
"""

import errno
import os
import sys
import warnings
from collections.abc import Sequence
from difflib import get_close_matches
from itertools import takewhile
from typing import TextIO

from cyclopts import App, CycloptsError
from cyclopts.exceptions import UnknownCommandError

from oed.cli.screen.fold import folding

COMMANDS = {
    "demo": "The whole loop on the embedded virtual robot: plan, touch, identify, verify.",
    "init": "Make a commented cell folder to start from.",
    "check": "Validate the cell, and compare it with poses read off the pendant.",
    "jig": "Propose a jig.yaml from the mesh of a part.",
    "run": "Make the touches of a plan over a serial line.",
    "program": "Write the touches of a plan in the controller's own language.",
    "import": "Read what such a program logged as touches.",
    "campaign": "Touch, identify and plan by turns, until the robot is as accurate as asked.",
    "virtual": "Serve a virtual robot cell on a pseudo-terminal or socket.",
    "plan": "Choose the touches that tell the most about the robot.",
    "identify": "Identify the parameters that put every touch on its face.",
    "verify": "Errors at touches or positions that the fit has not seen.",
    "compensate": "Corrected joints and command poses for wanted tip poses.",
    "fix": "Corrected copies of robot programs.",
    "export": "The calibrated robot for other tools.",
    "locate": "The pose of a workpiece, from touches on its faces.",
    "health": "Whether the robot is still the one that was identified.",
    "report": "One HTML page of a calibration: verdict, maps, 3-D view, parameters.",
    "study": "Answer a question with numbers: strategies, peers, the paper, and more.",
    "schema": "The JSON schema of cell.yaml, robot.yaml or jig.yaml, for editors.",
}
"""What each command does, in one line; its module in this package is loaded only when it runs."""
FUNCTIONS = {"import": "import_log:import_log", "schema": "init:schema"}  # where a command has no module of its name

GOES_ON = "what was finished is in its folder, and the same command goes on"
RESUMABLE = dict.fromkeys(("demo", "campaign", "study"), GOES_ON)
WHOLE = "a file is written whole or not at all: none is half-written"
"""What Ctrl-C leaves behind."""
BAD_INPUT, FAILED = 2, 1
DISK = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM}  # full, or not to be written


def application() -> App:
    """The command line; the modules of commands are loaded when they are called for."""
    app = App(
        name="touchcal",
        help_flags=(),
        version=_version,
        result_action="return_value",
        suppress_keyboard_interrupt=False,
    )
    for name in COMMANDS:
        app.command(f"oed.cli.{FUNCTIONS.get(name, f'{name}:{name}')}", name=name, help_flags=())
    app.register_install_completion_command()
    return app


def explain(name: str) -> int:
    """Print the help of a command, or of all; a signature and a docstring are enough."""
    from oed.cli.screen.help import overview, page

    print(page(application()[name]) if name else overview(COMMANDS))
    return 0


def _version() -> str:
    from importlib.metadata import version

    from identify.estimation.ipopt import ipopt_version

    return f"touchcal {version('touchcal')} (CasADi {version('casadi')}, Ipopt {ipopt_version()})"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; exit 0 when it worked, 2 on bad input, 1 when the work failed, never with a traceback."""
    with folding():
        sys.exit(_run(sys.argv[1:] if arguments is None else arguments))


def _run(arguments: Sequence[str]) -> int:
    """Run a command; its exit code."""
    warnings.showwarning = _warn
    # its threads cost more than matrices of 25 rows gain: a plan takes 36 s of processor time with two, 11 s with one
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    named = next((word for word in arguments if not word.startswith("-")), "")
    try:
        wants_help = not arguments or not {"--help", "-h"}.isdisjoint(takewhile(lambda word: word != "--", arguments))
        if wants_help and named in ("", *COMMANDS):
            code = explain(named)
        else:
            code = application()(arguments, exit_on_error=False, print_error=False)
        sys.stdout.flush()
    except CycloptsError as error:
        _say(f"{_sentence(error, arguments)}; see touchcal --help")
        code = BAD_INPUT
    except BrokenPipeError:  # who read the output has seen enough, as head does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except KeyboardInterrupt as stop:
        _say(str(stop) or f"stopped; {RESUMABLE.get(named, WHOLE)}")
        code = 130
    except Exception as error:
        if os.environ.get("TOUCHCAL_DEBUG"):
            raise
        code = _answer(error)
    return code if isinstance(code, int) else 0


def _sentence(error: CycloptsError, arguments: Sequence[str]) -> str:
    """What was wrong with the words of the command line."""
    if isinstance(error, UnknownCommandError):
        close = get_close_matches(arguments[0], COMMANDS, 1)
        return f"there is no command '{arguments[0]}'" + (f"; did you mean '{close[0]}'?" if close else "")
    return str(error).rstrip(".")


def _answer(error: Exception) -> int:
    """One sentence for what went wrong, and the exit code that goes with it."""
    from identify.estimation.calibrate import CalibrationFailed
    from identify.model.files import InputError
    from probe.line.controller import NotReady, TouchError

    if isinstance(error, (InputError, NotReady)):
        _say(str(error))
        return BAD_INPUT
    if isinstance(error, (CalibrationFailed, TouchError)):
        _say(str(error))
        return FAILED
    if isinstance(error, OSError) and error.errno in DISK:
        what = f"{error.filename}: cannot be written" if error.filename else "nothing more can be written"
        _say(f"{what}: {error.strerror}; make room or choose another folder, then go on: what was finished is on disk")
        return BAD_INPUT
    _say(
        f"unexpected {type(error).__name__}: {error}; please report it with the output of TOUCHCAL_DEBUG=1 touchcal ..."
    )
    return FAILED


def _say(text: str) -> None:
    print(f"touchcal: {text}", file=sys.stderr)


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    _say(f"warning: {message}")
