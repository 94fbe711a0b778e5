"""From a port and a protocol to a session of touches: the one place where port, controller, session and run meet."""

from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.touch import Plan
from probe import Session, Settings, open_controller, retreat, run
from probe.line.clock import Clock
from probe.line.controller import Controller
from probe.motion.joint_path import reach
from probe.runs.events import Finished, Listener, ignore
from probe.runs.journal import read_records
from probe.runs.session import journal_path
from probe.virtual.truth import Truth

SIM = "sim"


@dataclass(frozen=True)
class Touching:
    """A controller that answers, the session in which its touches are recorded, and the time that passes there."""

    plan: Plan
    controller: Controller
    session: Session
    clock: Clock

    def run(self, settings: Settings, tell: Listener = ignore) -> Finished:
        """Make the touches that the session does not have yet (see `probe.run`)."""
        return run(self.plan, self.controller, self.session, settings, tell=tell, clock=self.clock)

    def retreat(self, settings: Settings) -> None:
        """Bring the robot out of contact, back along its last motion."""
        retreat(self.controller, self.session, settings, clock=self.clock)


@dataclass(frozen=True)
class Connection:
    """How the controller is reached; port `sim` is a virtual robot that exists as long as the port is open."""

    port: str
    protocol: str
    options: Mapping[str, Any] = field(default_factory=dict)  # what `open_controller` takes besides
    truth: str | Truth | None = None  # of the virtual robot: as it is, a file, or library:NAME
    time_scale: float | None = None  # how many times faster than real time a virtual cell runs
    seed: int = 0  # of the scatter of the virtual robot

    @contextmanager
    def session(self, cell: Cell, believed_cell: Cell, plan: Plan, path: Path, *, resume: bool) -> Iterator[Touching]:
        """Connect, and record touches in the table at `path`; motions are checked by the robot of `believed_cell`."""
        with (
            self.controller(cell, plan, journal_path(path)) as (controller, clock),
            Session(path, believed_cell, plan, resume=resume, clock=clock) as session,
        ):
            yield Touching(plan, controller, session, clock)

    @contextmanager
    def controller(self, cell: Cell, plan: Plan, journal: Path) -> Iterator[tuple[Controller, Clock]]:
        """Connect; a virtual robot stands where the journal says that it was, else at the first approach."""
        with self._served(cell, plan, journal) as (url, clock):
            more = {"reach": reach(cell, plan)} if self.protocol == "grbl" else {}
            controller = open_controller(url, self.protocol, cell.robot, clock=clock, **(more | dict(self.options)))
            with closing(controller):
                yield controller, clock

    @contextmanager
    def _served(self, cell: Cell, plan: Plan, journal: Path) -> Iterator[tuple[str, Clock]]:
        """The port to open, and the time that passes there.

        The time of a virtual cell without a time scale jumps over motions; the driver then counts real seconds for all
        but the duration of the run.
        """
        scale = self.time_scale or np.inf
        pace = 1.0 if np.isinf(scale) else scale
        if self.port != SIM:
            yield self.port, Clock(pace)
            return
        from probe.virtual.server import serve

        if self.protocol not in ("line", "grbl"):
            raise InputError(
                f"port sim speaks line or grbl, not {self.protocol}; name the port of the {self.protocol} controller"
            )
        unit = self.options.get("axis_unit_deg") or cell.controller.axis_unit_deg
        options = {"protocol": self.protocol, "speed": scale, "axis_unit_deg": unit, "seed": self.seed}
        with serve(cell, self._truth(cell), start=_start(cell, plan, journal), **options) as virtual:
            yield virtual.url, Clock(pace, virtual.clock.now)

    def _truth(self, cell: Cell) -> Truth:
        """What the virtual robot truly is; drawn from the priors where the library knows none of its name."""
        from probe.virtual.command import choose_truth
        from probe.virtual.truth import LIBRARY, truths

        if isinstance(self.truth, Truth):
            return self.truth
        named = f"{LIBRARY}{cell.robot.name}" if cell.robot.name in truths() else None
        return choose_truth(cell, self.truth or named, 0)


def connection(
    cell: Cell,
    port: str | None = None,
    protocol: str | None = None,
    *,
    truth: str | None = None,
    time_scale: float | None = None,
    baud: int | None = None,
    axis_unit_deg: float | None = None,
    **options: Any,
) -> Connection:
    """The connection that the cell file describes, with what a user gives in its place; raises InputError."""
    controller = cell.controller
    if "" in (port, protocol, truth):
        option = "--port" if port == "" else "--protocol" if protocol == "" else "--truth"
        raise InputError(f"{option} is empty; write its value, or leave the option out")
    if axis_unit_deg is not None and not axis_unit_deg > 0:
        raise InputError(f"--axis-unit-deg is {axis_unit_deg:g}, expected a number above 0")
    if time_scale is not None and not time_scale > 0:
        raise InputError(f"--time-scale is {time_scale:g}, expected a number above 0")
    spoken = protocol or controller.protocol
    options = {name: value for name, value in options.items() if value} | {"baud": baud or controller.baud}
    if spoken == "grbl" or axis_unit_deg is not None:
        options["axis_unit_deg"] = axis_unit_deg or controller.axis_unit_deg
    return Connection(port or controller.port, spoken, options, truth, time_scale)


def _start(cell: Cell, plan: Plan, journal: Path) -> np.ndarray:
    """Where a virtual robot stands: where an interrupted run could go back to, else jogged to the first approach."""
    records = read_records(journal).records
    back = [record["back"] for record in records if record["kind"] == "intent"]
    return np.array(back[-1]) * cell.robot.joint_unit() if back else plan.approach[0]
