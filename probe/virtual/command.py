"""`python -m probe.virtual`: a virtual cell until somebody ends it."""

import argparse
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.description import read_cell
from probe.virtual.faults import KINDS
from probe.virtual.server import VirtualCell
from probe.virtual.truth import Truth, draw_truth, read_truth, truth_path


def choose_truth(cell: Cell, name: str | None, seed: int) -> Truth:
    """The truth of a file or of `library:NAME`; drawn from the cell's priors where none is named."""
    return draw_truth(cell, np.random.default_rng([seed, 1])) if name is None else read_truth(truth_path(name), cell)


def run(cell: Cell, truth: Truth, announce: Callable[[str], None] = print, **options: Any) -> VirtualCell:
    """Serve a cell until Ctrl-C or SIGTERM, having announced its URL; options as of VirtualCell."""
    served = VirtualCell(cell, truth, **options)

    def leave(*_: Any) -> None:
        served.stop()

    before = {number: signal.signal(number, leave) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        announce(served.url)
        served.run()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    return served


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; 2 on bad input."""
    try:
        options = _parser().parse_args(arguments)
        cell = read_cell(options.cell)
        truth = choose_truth(cell, options.truth, options.seed)
        start = None if options.start is None else _joints(options.start, cell)
        run(
            cell,
            truth,
            lambda url: print(url, flush=True),
            protocol=options.protocol,
            port=options.port,
            faults=options.fault,
            seed=options.seed,
            speed=options.speed,
            start=start,
            baud=options.baud,
            deadman=options.deadman,
            log=options.log,
            axis_unit_deg=options.axis_unit_deg,
        )
    except (ValueError, OSError) as error:  # InputError among them
        print(error, file=sys.stderr)
        return 2
    return 0


def _joints(text: str, cell: Cell) -> np.ndarray:
    values, joints = text.split(","), len(cell.robot.joints)
    if len(values) != joints:
        raise InputError(f"--start has {len(values)} joints, expected {joints} between commas")
    return cell.robot.from_controller(np.array([float(value) for value in values]))


def _parser() -> argparse.ArgumentParser:
    kinds = "; ".join(f"{kind}: {meaning}" for kind, (_, meaning) in KINDS.items())
    parser = argparse.ArgumentParser(prog="python -m probe.virtual", description=__doc__)
    parser.add_argument("--cell", type=Path, default=Path("cell.yaml"))
    parser.add_argument("--truth", help="a truth file or library:NAME; drawn from the priors where not given")
    parser.add_argument("--protocol", default="line", choices=["line", "grbl"])
    parser.add_argument("--port", default="pty", help="pty, socket or socket:PORT")
    parser.add_argument("--fault", action="append", default=[], help=f"KIND:RATE or KIND@N and options. {kinds}")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--speed", type=float, default=1.0, help="1 is real time; inf as fast as possible")
    parser.add_argument("--start", help="joints where the robot stands, deg or mm, between commas")
    parser.add_argument("--baud", type=int, help="send and take bytes no faster than that")
    parser.add_argument("--deadman", type=float, help="seconds of controller time")
    parser.add_argument("--axis-unit-deg", type=float, default=1.0, help="degrees in one axis unit of GRBL")
    parser.add_argument("--log", type=Path, help="JSON lines of what was executed and truly touched, for the judge")
    return parser
