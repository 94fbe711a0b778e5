"""The embedded virtual robot: port `sim` of the commands that touch."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.touch import Plan
from probe.clock import Clock
from probe.journal import read_records

SIM = "sim"


@contextmanager
def simulated(
    cell: Cell, protocol: str, truth: str | None, speed: float, start: Float[np.ndarray, " joints"]
) -> Iterator[tuple[str, Clock]]:
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
    with serve(cell, choose_truth(cell, truth or known, 0), protocol=protocol, speed=speed, start=start) as served:
        yield served.url, Clock(1.0 if np.isinf(speed) else speed, served.clock.now)


def standing(journal: Path, cell: Cell, plan: Plan) -> Float[np.ndarray, " joints"]:
    """Where a virtual robot stands: where an interrupted run could go back to, else jogged to the first approach."""
    records = read_records(journal)[0] if journal.exists() else []
    back = [record["back"] for record in records if record["kind"] == "intent"]
    return np.array(back[-1]) * cell.robot.joint_unit() if back else plan.approach[0]
