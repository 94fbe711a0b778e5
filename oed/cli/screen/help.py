"""What `--help` prints: the commands, or the docstring and the options of one."""

import inspect
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import get_args

from cyclopts import App, Argument

WIDEST = 100  # characters of a line
COLUMN = 28  # where the explanation of an option begins
COMPLETION = "Complete commands and options in this shell from now on."
EXIT_CODES = (
    "Exit codes: 0 done; 1 the work failed, or its answer is no (target missed, robot changed, pendant disagrees); "
    "2 bad input, nothing was changed; 130 stopped by Ctrl-C."
)
KINDS = {int: "INTEGER", float: "NUMBER", str: "TEXT", Path: "PATH"}


def overview(commands: Mapping[str, str]) -> str:
    """What touchcal is for, and what each command does."""
    rows = {
        **commands,
        "--help, -h": "Explain touchcal, or the command before it.",
        "--version": "Print the versions of touchcal, CasADi and Ipopt.",
        "--install-completion": COMPLETION,
    }
    return "\n".join(
        (
            "Usage: touchcal COMMAND\n",
            "Calibrate a welding robot with its own wire, a machined jig and a serial line.\n",
            "Commands:",
            *(_row(name, line, 14) for name, line in rows.items()),
            f"\n{_filled(EXIT_CODES)}",
            "\nStart with: touchcal demo -o demo. More of a command: touchcal plan --help.",
        )
    )


def page(app: App) -> str:
    """How a command is called, its docstring and its options."""
    prose, _, _ = (inspect.getdoc(app.default_command) or "").partition("\nParameters\n")
    arguments = [argument for argument in app.assemble_argument_collection(parse_docstring=True) if argument.show]
    places = [argument for argument in arguments if argument.index is not None]
    options = [argument for argument in arguments if argument.index is None]
    blocks = [f"Usage: {' '.join(('touchcal', app.name[0], *_usage(places, options)))}"]
    blocks += [_paragraph(text) for text in re.split(r"\n\n+", prose.rstrip())]
    blocks += ["Arguments:\n" + "\n".join(_row(_place(a), _explanation(a)) for a in places)] if places else []
    blocks += ["Options:\n" + "\n".join(_row(_option(a), _explanation(a)) for a in options)] if options else []
    return "\n\n".join([*blocks, _filled(EXIT_CODES)])


def _width() -> int:
    return min(shutil.get_terminal_size().columns, WIDEST)


def _filled(text: str, margin: str = "") -> str:
    """Text that fills the width behind a margin; what stands in brackets stays together."""
    whole = re.sub(r"\[[^]]*\]$", lambda brackets: brackets[0].replace(" ", "\xa0"), text)
    lines = fill(whole, _width(), initial_indent=margin, subsequent_indent=margin, break_on_hyphens=False)
    return lines.replace("\xa0", " ")


def _paragraph(text: str) -> str:
    """Prose fills the width; an example stays one line, to be copied."""
    return text if text.startswith(" ") else _filled(text)


def _row(name: str, explanation: str, column: int = COLUMN) -> str:
    """A name, and from a column on what it is."""
    head, text = f"  {name}", _filled(explanation, " " * column)
    return f"{head:{column}}{text[column:]}" if len(head) + 2 <= column else f"{head}\n{text}"


def _usage(places: Sequence[Argument], options: Sequence[Argument]) -> list[str]:
    """What must be given, and what may be."""
    required = [f"{option.name} {_value(option)}" for option in options if option.required]
    more = [] if len(required) == len(options) else ["[OPTIONS]"]
    return [*required, *more, *(_place(a) if a.required else f"[{_place(a)}]" for a in places)]


def _place(argument: Argument) -> str:
    name = argument.field_info.name.upper()
    return f"{name}..." if argument.is_var_positional() else name


def _option(argument: Argument) -> str:
    names = ", ".join(sorted(argument.names, key=lambda name: name.startswith("--")))
    return f"{names} {_value(argument)}".rstrip()


def _value(argument: Argument) -> str:
    """What an option has to be followed by; nothing where it is a flag."""
    choices = argument.get_choices()
    if choices or argument.is_flag():
        return "|".join(choices or ())
    kinds = {argument.hint, *get_args(argument.hint)}
    return next(word for kind, word in KINDS.items() if kind in kinds) + ("..." if ... in kinds else "")


def _explanation(argument: Argument) -> str:
    """Its sentence, and what it is if it is not given."""
    text = " ".join((argument.parameter.help or "").split())
    if argument.required:
        return text if argument.index is not None else f"{text} [required]"
    default = argument.field_info.default
    unset = default in (None, (), "", inspect.Parameter.empty) or default is False
    return text if unset else f"{text} [default: {default}]"
