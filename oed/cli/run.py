"""`touchcal run`."""

import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from identify.model.files import InputError, write_text
from oed.cli.options import CellFile, Flag, Json, Output, Port, load_cell, next_command, print_json
from oed.cli.screen.live import Screen

if TYPE_CHECKING:
    from identify.model.cell import Cell
    from identify.model.touch import Plan
    from oed.campaigns.connection import Connection, Touching
    from probe import Session, Settings
    from probe.runs.delay import Delay
    from probe.runs.events import Finished

FASTER = 6.0  # a first search, times the second: a hundred such pairs leave 2 micrometres of the bias, 1 sigma


@Parameter(name="*")
@dataclass(frozen=True)
class Line(Port):
    """How the controller is reached, and what it is asked to do first."""

    baud: int | None = None
    """Speed of the serial line, in place of the cell's."""
    axis_unit_deg: float | None = None
    """GRBL: degrees in one unit of a turning axis, in place of the cell's; 0.1 makes the most of its three decimals."""
    home: Flag = False
    """GRBL, LinuxCNC: home the machine first. The robot moves."""
    unlock: Flag = False
    """GRBL: unlock it where an alarm holds it; you have checked that its position is right."""
    transcript: Path | None = None
    """Write what goes over the line, with times."""
    time_scale: float | None = None
    """With a virtual cell: how many times faster than real time it runs. Port sim is as fast as it can be without it; a
    cell of touchcal virtual wants the number that it was given there, if that is not inf."""


@Parameter(name="*")
@dataclass(frozen=True)
class Manner:
    """How touches are made, and what is noted with them."""

    trust_position: Flag = False
    """You have checked where the robot stands, after a restart of its controller or a move by hand."""
    override: float = 1.0
    """Speed of the moves, 0 to 1; searches keep their own."""
    search_speed: float | None = None
    """Of the tip, mm/s, in place of the cell's."""
    two_speeds: Flag = False
    """Search first at six times that speed, back off, and search again: how late the touch signal comes is told, and
    touches-corrected.csv has it taken out."""
    fast_speed: float | None = None
    """The same with a first search at this speed in mm/s."""
    again_every: int = 0
    """Touch a known point again after so many touches, to see drift."""
    temperature: float | None = None
    """Degrees Celsius of robot or hall, noted with every touch."""
    note: str = ""
    """A remark, noted with every touch."""

    def settings(self, cell: "Cell", connection: "Connection") -> "Settings":
        """The settings of the driver; a virtual robot stands where it says."""
        from oed.campaigns.connection import SIM
        from probe import Settings

        if not 0 < self.override <= 1:
            raise InputError(f"--override is {self.override:g}, expected more than 0 and at most 1")
        slow = self.search_speed or cell.touch.speed
        return Settings(
            override=self.override,
            search_speed=slow,
            fast_speed=self.fast_speed or (FASTER * slow if self.two_speeds else None),
            again_every=self.again_every,
            temperature=self.temperature,
            note=self.note,
            trust_position=self.trust_position or connection.port == SIM,
        )


CELL_LINE, USUAL = Line(), Manner()


def run(
    plan: Path,
    *,
    cell: CellFile = Path("cell.yaml"),
    after: Path | None = None,
    output: Output = Path("touches.csv"),
    line: Line = CELL_LINE,
    resume: Flag = False,
    dry_run: Flag = False,
    manner: Manner = USUAL,
    json: Json = False,
) -> int:
    """Make the touches of a plan, and append them to touches.csv.

    The whole plan is checked before the first motion. A touch far from where those before it foretell is made again;
    three in a row without a hit end the run. A touch to which no clear way leads is skipped. Ctrl-C stops the robot,
    then asks whether to retract; --resume goes on where a run stopped, whatever stopped it, and completes touches.csv
    from the journal beside it. With port sim the embedded virtual robot makes the touches. Examples:

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
    resume
        Go on with the run that touches.csv and its journal belong to.
    dry_run
        Visit every approach from 25 mm further off, touch nothing, write nothing.
    """
    from identify.estimation.face_association import as_identified
    from identify.model.io.calibration_file import read_calibration
    from identify.model.io.tables import read_plan

    described = load_cell(cell)
    touch_plan = read_plan(plan, described)
    robot = described if after is None else as_identified(described, read_calibration(after))
    connection = line.connection(described)
    settings, screen = manner.settings(described, connection), Screen(silent=json)
    if dry_run:
        _tell_visits(_rehearse(connection, described, robot, touch_plan, output, settings, screen), json)
        return 0
    finished, delay = make_touches(connection, described, robot, touch_plan, output, settings, screen, resume=resume)
    _tell(finished, output, delay, settings, next_command(plan, _beside(output) if delay else output), json)
    return 0


def make_touches(
    connection: "Connection",
    cell: "Cell",
    robot: "Cell",
    plan: "Plan",
    output: Path,
    settings: "Settings",
    screen: Screen,
    *,
    resume: bool,
) -> "tuple[Finished, Delay | None]":
    """Make the touches of a plan; Ctrl-C stops the robot and offers to retract. The delay is that of two speeds."""
    from probe.runs.preflight import validate

    validate(plan, robot, settings, len(cell.robot.joints))  # before anything is opened or written
    with connection.session(cell, robot, plan, output, resume=resume) as touching:
        if touching.session.repaired:
            print(f"touchcal: {touching.session.repaired}", file=sys.stderr)
        try:
            with screen:
                finished = touching.run(settings, screen.tell)
        except KeyboardInterrupt:
            _after_stop(touching, settings)
            raise KeyboardInterrupt("go on with --resume; every touch made so far is in the table") from None
        return finished, _corrected(touching.session, output) if settings.fast_speed else None


def _rehearse(
    connection: "Connection",
    cell: "Cell",
    robot: "Cell",
    plan: "Plan",
    output: Path,
    settings: "Settings",
    screen: Screen,
) -> "Finished":
    from probe import rehearse
    from probe.runs.preflight import validate
    from probe.runs.session import journal_path

    validate(plan, robot, settings, len(cell.robot.joints))
    with connection.controller(cell, plan, journal_path(output)) as (controller, clock), screen:
        return rehearse(plan, controller, robot, settings, tell=screen.tell, clock=clock)


def _after_stop(touching: "Touching", settings: "Settings") -> None:
    """The robot stands; bring it out of contact if a person says so."""
    print("touchcal: stopped; the robot stands still", file=sys.stderr)
    if sys.stdin.isatty() and input("retract to the last approach? [y/N] ").strip().lower().startswith("y"):
        touching.retreat(settings)
        print("touchcal: retracted", file=sys.stderr)


def _corrected(session: "Session", output: Path) -> "Delay | None":
    """How late touches come, and a table of them without that, beside touches.csv, which holds what was measured."""
    from identify.model.io.tables import touches_text
    from probe import estimate_delay
    from probe.runs.delay import without_delay

    try:
        delay = estimate_delay(session.results.values(), session.cell)
    except InputError:  # fewer than three pairs tell nothing
        return None
    touches = without_delay(session.results.values(), session.cell, delay.seconds)
    write_text(_beside(output), touches_text(touches, session.cell.robot))
    return delay


def _beside(output: Path) -> Path:
    return output.with_name(f"{output.stem}-corrected{output.suffix}")


def _tell_visits(finished: "Finished", json: bool) -> None:
    """What a dry run did."""
    minutes = finished.seconds / 60
    if json:
        print_json({"hits": finished.hits, "touches": finished.total, "minutes": minutes})
    else:
        print(f"{finished.total} approaches visited in {minutes:.1f} minutes, nothing touched")


def _tell(
    finished: "Finished", output: Path, delay: "Delay | None", settings: "Settings", after: str, json: bool
) -> None:
    """What a run did."""
    minutes = finished.seconds / 60
    if json:
        facts = {"hits": finished.hits, "touches": finished.total, "minutes": minutes}
        print_json(facts | {"skipped": dict(finished.skipped)} | ({"delay": asdict(delay)} if delay else {}))
        return
    for reason in dict.fromkeys(finished.skipped.values()):
        print(f"skipped {', '.join(name for name, why in finished.skipped.items() if why == reason)}: {reason}")
    if delay:
        slow = settings.search_speed or 0.0
        print(
            f"the touch signal comes {1000 * delay.seconds:.2f} ms late (1 sigma {1000 * delay.sigma:.2f} ms, from "
            f"{delay.pairs} touches at two speeds), {delay.seconds * slow:.4f} mm at {slow:g} mm/s: taken out in "
            f"{_beside(output)}, where {delay.sigma * slow:.4f} mm of it may be left"
        )
    print(f"{finished.hits} of {finished.total} touches made in {minutes:.1f} minutes; go on with {after}")
