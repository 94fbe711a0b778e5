"""`touchcal run`."""

import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.tables import read_plan
from identify.model.touch import Plan
from oed.cli.live import Screen
from oed.cli.options import CellFile, Json, load_cell, print_json
from oed.cli.sim import SIM, simulated, standing
from probe import Session, Settings, open_controller, rehearse, retreat
from probe import run as make_touches
from probe.clock import Clock
from probe.events import Finished
from probe.preflight import validate
from probe.session import journal_path


def run(
    plan: Path,
    *,
    cell: CellFile = Path("cell.yaml"),
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("touches.csv"),
    port: str | None = None,
    protocol: str | None = None,
    baud: int | None = None,
    resume: Annotated[bool, Parameter(negative=())] = False,
    dry_run: Annotated[bool, Parameter(negative=())] = False,
    trust_position: Annotated[bool, Parameter(negative=())] = False,
    home: Annotated[bool, Parameter(negative=())] = False,
    override: float = 1.0,
    fast_speed: float | None = None,
    again_every: int = 0,
    temperature: float | None = None,
    note: str = "",
    transcript: Path | None = None,
    truth: str | None = None,
    time_scale: float | None = None,
    json: Json = False,
) -> int:
    """Make the touches of a plan, and append them to touches.csv.

    The whole plan is checked before the first motion. Ctrl-C stops the robot, then asks whether to retract; --resume
    goes on where a run stopped, whatever stopped it. With port sim the embedded virtual robot makes the touches.
    Example:

        touchcal run plan.csv --port /dev/ttyUSB0 --protocol line

    Parameters
    ----------
    plan
        What touchcal plan wrote.
    output
        Where touches are appended; the journal of the run is written beside it.
    port
        /dev/ttyUSB0, COM5, socket://host:port or sim, in place of the cell's.
    protocol
        line (TOUCH/1), grbl or linuxcnc, in place of the cell's.
    baud
        Speed of the serial line, in place of the cell's.
    resume
        Go on with the run that touches.csv and its journal belong to.
    dry_run
        Visit every approach at a safe distance and touch nothing.
    trust_position
        You have checked where the robot stands, after a restart of its controller or a move by hand.
    home
        Home a LinuxCNC machine first.
    override
        Speed of the moves, 0 to 1; searches keep their own.
    fast_speed
        Search first at this speed in mm/s, back off, and search again at the cell's.
    again_every
        Touch the first point again after so many touches, to see drift.
    temperature
        Degrees Celsius of robot or hall, noted with every touch.
    note
        A remark, noted with every touch.
    transcript
        Write what goes over the line, with times.
    truth
        With port sim: what the virtual robot truly is, a file or library:arc-welder; drawn from the priors where the
        library knows none of that name.
    time_scale
        With a virtual cell: how many times faster than real time it runs. Port sim is as fast as it can be without it;
        a cell of touchcal virtual wants the number that it was given there, if that is not inf.
    """
    described = load_cell(cell)
    planned = read_plan(plan, described)
    if not 0 < override <= 1:
        raise InputError(f"--override is {override:g}, expected more than 0 and at most 1")
    if time_scale is not None and not time_scale > 0:
        raise InputError(f"--time-scale is {time_scale:g}, expected a number above 0")
    where = port or described.controller.port
    settings = Settings(
        override=override, fast_speed=fast_speed, again_every=again_every, temperature=temperature, note=note,
        trust_position=trust_position or where == SIM,
    )  # fmt: skip
    validate(planned, described, settings, len(described.robot.joints))  # before anything is opened or written
    line: dict[str, Any] = {"baud": baud or described.controller.baud, "transcript": transcript}
    spoken = protocol or described.controller.protocol
    screen = Screen(silent=json)
    with _port(where, spoken, described, planned, truth, time_scale, journal_path(output)) as (url, clock):
        line |= {"clock": clock} | ({"home": True} if home else {})
        controller = open_controller(url, spoken, described.robot, **line)
        with closing(controller):
            if dry_run:
                with screen:
                    finished = rehearse(planned, controller, described, settings, tell=screen.tell, clock=clock)
            else:
                with Session(output, described, planned, resume=resume, clock=clock) as session:
                    try:
                        with screen:
                            finished = make_touches(
                                planned, controller, session, settings, tell=screen.tell, clock=clock
                            )
                    except KeyboardInterrupt:
                        _after_stop(controller, session, settings, clock)
                        return 130
    _tell(finished, output, dry_run, json)
    return 0


def _after_stop(controller: Any, session: Session, settings: Settings, clock: Clock) -> None:
    """The robot stands; bring it out of contact if a person says so."""
    print("touchcal: stopped; the robot stands still", file=sys.stderr)
    if sys.stdin.isatty() and input("retract to the last approach? [y/N] ").strip().lower().startswith("y"):
        retreat(controller, session, settings, clock=clock)
        print("touchcal: retracted", file=sys.stderr)
    print("touchcal: go on with --resume; every touch made so far is in the table", file=sys.stderr)


def _tell(finished: Finished, output: Path, dry_run: bool, json: bool) -> None:
    if json:
        print_json({"hits": finished.hits, "touches": finished.total, "minutes": finished.seconds / 60})
    elif dry_run:
        print(f"{finished.total} approaches visited in {finished.seconds / 60:.1f} minutes, nothing touched")
    else:
        print(
            f"{finished.hits} of {finished.total} touches made in {finished.seconds / 60:.1f} minutes; go on with "
            f"touchcal identify {output}"
        )


@contextmanager
def _port(
    where: str, protocol: str, cell: Cell, plan: Plan, truth: str | None, speed: float | None, journal: Path
) -> Iterator[tuple[str, Clock]]:
    """The port to open, and the time that passes there; for `sim`, those of a virtual cell of our own."""
    if where != SIM:
        yield where, Clock(1.0 if speed is None or np.isinf(speed) else speed)
        return
    with simulated(cell, protocol, truth, speed or np.inf, standing(journal, cell, plan)) as served:
        yield served
