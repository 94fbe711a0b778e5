"""The makers whose controllers touchcal writes programs for: one row each."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from identify.model.cell import Cell
from identify.model.files import InputError, nearest
from identify.model.robot import Robot
from identify.model.touch import Plan
from probe.programs import abb, fanuc, kuka, ur, yaskawa
from probe.programs.log import Log, stamp
from probe.programs.options import Options
from probe.programs.page import Instructions, page
from probe.programs.part import Part, parts
from probe.programs.routine import near_approaches, routines

PAGE = "OPERATOR.md"


@dataclass(frozen=True)
class Program:
    """What an operator is given."""

    files: dict[str, str]  # by name, and the page for the operator
    notes: tuple[str, ...]  # sentences that stand in that page and on the screen


@dataclass(frozen=True)
class Maker:
    """How a maker's controllers touch."""

    instructions: Instructions
    straight: bool  # whether the tip searches along a line; else all joints move in proportion
    signal: str  # pattern of the notation of a touch input
    example: str  # of that notation, and the usual
    tool: str  # pattern of what names a tool or a frame
    capacity: Callable[[Options], int]
    write: Callable[[Part], dict[str, str]]
    read: Callable[[Sequence[Path], Robot, int], list[Log]]

    @property
    def _input(self) -> str:
        return "a number from 0 to 7" if self.example.isdigit() else f"one like {self.example}"

    def check(self, options: Options) -> None:
        """Raise InputError where an option is not in the notation of this maker."""
        options.check()
        frame = "a number" if self.tool == NUMBER else "a name"
        for name, value, pattern, form in (
            ("--input", options.input, self.signal, self._input),
            ("--tool", options.tool, self.tool, frame),
            ("--frame", options.frame, self.tool, frame),
        ):
            if value and not re.fullmatch(pattern, value):
                raise InputError(f"{name} is '{value}', expected {form} on {self.instructions.title}")


COUPLED = ("fanuc",)  # controllers that count joint 3 together with joint 2
NUMBER, NAME = r"\d{1,3}", r"[A-Za-z]\w{0,31}"
KUKA_INPUT = r"\$(MEAS_PULSE\[[1-5]\]|IN\[\d+\])"
MAKERS = {
    name: Maker(module.INSTRUCTIONS, straight, signal, example, tool, module.capacity, module.write, module.read)
    for name, module, straight, signal, example, tool in (
        ("fanuc", fanuc, False, r"(DI|RI|WI)\[\d+\]", "DI[1]", NUMBER),
        ("kuka", kuka, True, KUKA_INPUT, "$MEAS_PULSE[1]", NUMBER),
        ("abb", abb, True, NAME, "diTouch", NAME),
        ("yaskawa", yaskawa, True, r"RIN#\(\d+\),IN#\(\d+\)", "RIN#(1),IN#(1)", NUMBER),
        ("ur", ur, False, "[0-7]", "0", NUMBER),
    )
}


def maker_of(name: str) -> Maker:
    """The row of a maker; raises InputError where there is none of that name."""
    if name not in MAKERS:
        raise InputError(f"--maker is '{name}', expected one of {', '.join(MAKERS)}{nearest(name, MAKERS)}")
    return MAKERS[name]


def program(plan: Plan, cell: Cell, name: str, options: Options) -> Program:
    """A program that makes the touches of a plan, and the page for its operator.

    Raises InputError with everything that speaks against the plan or the options.
    """
    maker = maker_of(name)
    maker.check(options)
    _check_counting(cell, name)
    speed = round(options.search_speed or cell.touch.speed, 3)
    options = replace(options, search_speed=speed)
    touches = routines(plan, cell, options, straight=maker.straight)
    capacity = maker.capacity(options)
    if capacity < 1:
        title = maker.instructions.title
        raise InputError(f"no register is left for a touch on {title}: lower --first-register, or raise --registers")
    split = parts(touches, options, stamp(plan, cell.robot, name), speed, cell.robot, capacity)
    notes = near_approaches(touches) if options.rehearsal else ()
    files = {k: text for part in split for k, text in maker.write(part).items()}
    return Program(files | {PAGE: page(maker.instructions, maker.example, split, options, notes)}, notes)


def _check_counting(cell: Cell, name: str) -> None:
    """Raise InputError where the cell leaves open what moves the arms of a maker: how joint 3 is counted."""
    if name not in COUPLED or cell.robot.counting.stated or len(cell.robot.joints) < 3:
        return
    second, third = (cell.robot.joints[i].name for i in (1, 2))
    raise InputError(
        f"cell.yaml does not say how the controller counts {third}: {MAKERS[name].instructions.title} "
        f"counts it together with {second}, and the arm goes elsewhere where the model does not. Read some poses off "
        "the pendant, then touchcal check --pendant pendant.csv --fix writes it; or write joints: {coupled: "
        f"{{{third}: {second}}}}}, or joints: {{coupled: {{}}}} where no joint is counted together with another"
    )


def read_logs(paths: Sequence[Path], plan: Plan, cell: Cell, name: str) -> list[Log]:
    """What programs of a maker logged; raises InputError with file, line and cure."""
    maker = maker_of(name)
    _check_counting(cell, name)
    return maker.read(paths, cell.robot, stamp(plan, cell.robot, name))
