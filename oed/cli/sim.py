"""The ports of the commands that touch: how they are spoken to, and `sim`, the embedded virtual robot."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell, Controller
from identify.model.files import InputError
from identify.model.touch import Plan
from probe.line.clock import Clock
from probe.runs.journal import read_records

SIM = "sim"


def line_options(
    controller: Controller, protocol: str, *, baud: int | None = None, axis_unit_deg: float | None = None,
    home: bool = False, unlock: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """What `open_controller` is told beyond port and protocol: by the cell file, and in its place by the user."""
    if axis_unit_deg is not None and not axis_unit_deg > 0:
        raise InputError(f"--axis-unit-deg is {axis_unit_deg:g}, expected a number above 0")
    options: dict[str, Any] = {"baud": baud or controller.baud}
    if protocol == "grbl" or axis_unit_deg is not None:
        options["axis_unit_deg"] = axis_unit_deg or controller.axis_unit_deg
    return options | {name: True for name, asked in (("home", home), ("unlock", unlock)) if asked}


@contextmanager
def simulated(
    cell: Cell, protocol: str, truth: str | None, speed: float, start: Float[np.ndarray, " joints"],
    axis_unit_deg: float | None = None,
) -> Iterator[tuple[str, Clock]]:  # fmt: skip
    """The port of a virtual cell that lives as long as the block, and the clock to run it by.

    `speed` is how many times faster than real time it is; where infinite, its time jumps over motions, and the driver
    counts real seconds for all but the duration of the run.
    """
    from probe.virtual.command import choose_truth
    from probe.virtual.server import serve
    from probe.virtual.truth import LIBRARY, truths

    if protocol not in ("line", "grbl"):
        raise InputError(f"port sim speaks line or grbl, not {protocol}; name the port of the {protocol} controller")
    known = f"{LIBRARY}{cell.robot.name}" if cell.robot.name in truths() else None
    hidden, unit = choose_truth(cell, truth or known, 0), axis_unit_deg or cell.controller.axis_unit_deg
    with serve(cell, hidden, protocol=protocol, speed=speed, start=start, axis_unit_deg=unit) as served:
        yield served.url, Clock(1.0 if np.isinf(speed) else speed, served.clock.now)


def standing(journal: Path, cell: Cell, plan: Plan) -> Float[np.ndarray, " joints"]:
    """Where a virtual robot stands: where an interrupted run could go back to, else jogged to the first approach."""
    records = read_records(journal)[0] if journal.exists() else []
    back = [record["back"] for record in records if record["kind"] == "intent"]
    return np.array(back[-1]) * cell.robot.joint_unit() if back else plan.approach[0]
