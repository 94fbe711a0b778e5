"""`touchcal run`."""

import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from identify.estimation.face_association import as_identified
from identify.model.cell import Cell
from identify.model.files import InputError, write_text
from identify.model.io.calibration_file import read_calibration
from identify.model.io.tables import read_plan, touches_text
from identify.model.touch import Plan
from oed.cli.live import Screen
from oed.cli.options import CellFile, Json, load_cell, print_json
from oed.cli.sim import SIM, line_options, simulated, standing
from probe import Session, Settings, estimate_delay, open_controller, rehearse, retreat
from probe import run as make_touches
from probe.line.clock import Clock
from probe.runs.delay import Delay, without_delay
from probe.runs.events import Finished
from probe.runs.preflight import validate
from probe.runs.session import journal_path

FASTER = 6.0  # a first search, times the second: a hundred such pairs leave 2 micrometres of the bias, 1 sigma


def run(
    plan: Path,
    *,
    cell: CellFile = Path("cell.yaml"),
    after: Path | None = None,
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("touches.csv"),
    port: str | None = None,
    protocol: str | None = None,
    baud: int | None = None,
    axis_unit_deg: float | None = None,
    home: Annotated[bool, Parameter(negative=())] = False,
    unlock: Annotated[bool, Parameter(negative=())] = False,
    resume: Annotated[bool, Parameter(negative=())] = False,
    trust_position: Annotated[bool, Parameter(negative=())] = False,
    dry_run: Annotated[bool, Parameter(negative=())] = False,
    override: float = 1.0,
    search_speed: float | None = None,
    two_speeds: Annotated[bool, Parameter(negative=())] = False,
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

    The whole plan is checked before the first motion. A touch far from where the touches before it foretell is made
    again at once; three in a row without a hit end the run. Ctrl-C stops the robot, then asks whether to retract;
    --resume goes on where a run stopped, whatever stopped it, and completes touches.csv from the journal beside it.
    With port sim the embedded virtual robot makes the touches. Examples:

        touchcal run plan.csv --port /dev/ttyUSB0 --protocol line --dry-run --override 0.2

        touchcal run plan.csv --port /dev/ttyUSB0 --protocol line --two-speeds --again-every 20 --temperature 21.5

        touchcal run plan.csv --port socket://192.168.0.5:5007 --protocol linuxcnc --home

        touchcal run plan.csv --port /dev/ttyACM0 --protocol grbl --axis-unit-deg 0.1 --unlock

    Parameters
    ----------
    plan
        What touchcal plan wrote.
    after
        An earlier calibration.json, where the plan was made after one: motions are checked by the robot that it found.
    output
        Where touches are appended; the journal of the run is written beside it.
    port
        /dev/ttyUSB0, COM5, socket://host:port, rfc2217://host:port or sim, in place of the cell's.
    protocol
        line (TOUCH/1), grbl or linuxcnc, in place of the cell's.
    baud
        Speed of the serial line, in place of the cell's.
    axis_unit_deg
        GRBL: degrees in one unit of a turning axis, in place of the cell's; 0.1 makes the most of its three decimals.
    home
        GRBL, LinuxCNC: home the machine first. The robot moves.
    unlock
        GRBL: unlock it where an alarm holds it; you have checked that its position is right.
    resume
        Go on with the run that touches.csv and its journal belong to.
    trust_position
        You have checked where the robot stands, after a restart of its controller or a move by hand.
    dry_run
        Visit every approach from 25 mm further off, touch nothing, write nothing.
    override
        Speed of the moves, 0 to 1; searches keep their own.
    search_speed
        Of the tip, mm/s, in place of the cell's.
    two_speeds
        Search first at six times that speed, back off, and search again: how late the touch signal comes is told, and
        touches-corrected.csv has it taken out.
    fast_speed
        The same with a first search at this speed in mm/s.
    again_every
        Touch a known point again after so many touches, to see drift.
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
    known = described if after is None else as_identified(described, read_calibration(after))
    _expect("--override", override, "more than 0 and at most 1", 0 < override <= 1)
    _expect("--time-scale", time_scale, "a number above 0", time_scale is None or time_scale > 0)
    where, spoken = port or described.controller.port, protocol or described.controller.protocol
    slow = search_speed or described.touch.speed
    settings = Settings(
        override=override, search_speed=slow, fast_speed=fast_speed or (FASTER * slow if two_speeds else None),
        again_every=again_every, temperature=temperature, note=note, trust_position=trust_position or where == SIM,
    )  # fmt: skip
    validate(planned, known, settings, len(described.robot.joints))  # before anything is opened or written
    options = line_options(
        described.controller, spoken, baud=baud, axis_unit_deg=axis_unit_deg, home=home, unlock=unlock
    )
    screen, delay = Screen(silent=json), None
    with _port(where, spoken, described, planned, truth, time_scale, journal_path(output), axis_unit_deg) as (
        url,
        clock,
    ):
        controller = open_controller(url, spoken, described.robot, clock=clock, transcript=transcript, **options)
        with closing(controller):
            if dry_run:
                with screen:
                    finished = rehearse(planned, controller, known, settings, tell=screen.tell, clock=clock)
            else:
                with Session(output, known, planned, resume=resume, clock=clock) as session:
                    if session.repaired:
                        print(f"touchcal: {session.repaired}", file=sys.stderr)
                    try:
                        with screen:
                            finished = make_touches(
                                planned, controller, session, settings, tell=screen.tell, clock=clock
                            )
                    except KeyboardInterrupt:
                        _after_stop(controller, session, settings, clock)
                        return 130
                    delay = _corrected(session, output) if settings.fast_speed else None
    _tell(finished, output, delay, settings, dry_run, json)
    return 0


def _expect(option: str, value: float | None, expected: str, kept: bool) -> None:
    if not kept:
        raise InputError(f"{option} is {value:g}, expected {expected}")


def _after_stop(controller: Any, session: Session, settings: Settings, clock: Clock) -> None:
    """The robot stands; bring it out of contact if a person says so."""
    print("touchcal: stopped; the robot stands still", file=sys.stderr)
    if sys.stdin.isatty() and input("retract to the last approach? [y/N] ").strip().lower().startswith("y"):
        retreat(controller, session, settings, clock=clock)
        print("touchcal: retracted", file=sys.stderr)
    print("touchcal: go on with --resume; every touch made so far is in the table", file=sys.stderr)


def _corrected(session: Session, output: Path) -> Delay | None:
    """How late touches come, and a table of them without that, beside touches.csv, which holds what was measured."""
    try:
        delay = estimate_delay(session.results.values(), session.cell)
    except InputError:  # fewer than three pairs tell nothing
        return None
    touches = without_delay(session.results.values(), session.cell, delay.seconds)
    write_text(_beside(output), touches_text(touches, session.cell.robot))
    return delay


def _beside(output: Path) -> Path:
    return output.with_name(f"{output.stem}-corrected{output.suffix}")


def _tell(finished: Finished, output: Path, delay: Delay | None, settings: Settings, dry_run: bool, json: bool) -> None:
    minutes = finished.seconds / 60
    if json:
        told = {"hits": finished.hits, "touches": finished.total, "minutes": minutes}
        print_json(told | ({"delay": asdict(delay)} if delay else {}))
        return
    if dry_run:
        print(f"{finished.total} approaches visited in {minutes:.1f} minutes, nothing touched")
        return
    if delay:
        slow = settings.search_speed or 0.0
        print(
            f"the touch signal comes {1000 * delay.seconds:.2f} ms late (1 sigma {1000 * delay.sigma:.2f} ms, from "
            f"{delay.pairs} touches at two speeds), {delay.seconds * slow:.4f} mm at {slow:g} mm/s: taken out in "
            f"{_beside(output)}, where {delay.sigma * slow:.4f} mm of it may be left"
        )
    print(
        f"{finished.hits} of {finished.total} touches made in {minutes:.1f} minutes; go on with "
        f"touchcal identify {_beside(output) if delay else output}"
    )


@contextmanager
def _port(
    where: str, protocol: str, cell: Cell, plan: Plan, truth: str | None, speed: float | None, journal: Path,
    axis_unit_deg: float | None,
) -> Iterator[tuple[str, Clock]]:  # fmt: skip
    """The port to open, and the time that passes there; for `sim`, those of a virtual cell of our own."""
    if where != SIM:
        yield where, Clock(1.0 if speed is None or np.isinf(speed) else speed)
        return
    at = standing(journal, cell, plan)
    with simulated(cell, protocol, truth, speed or np.inf, at, axis_unit_deg) as served:
        yield served
