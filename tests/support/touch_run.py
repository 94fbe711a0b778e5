"""A driver to be killed: for each line `PORT PROTOCOL FOLDER SCALE` on standard input, one run in its own process.

Everything is imported once, then forked; the number of the process is printed, and `ended` when it has. A run that is
complete leaves a file `done` in its folder.
"""

import os
import sys
import traceback
from pathlib import Path

from touching import clear_plan, pointed

from identify.model.cell import Cell
from identify.model.io.description import library, read_cell
from identify.model.touch import Plan
from probe.controllers import open_controller
from probe.line.clock import Clock
from probe.motion.settings import Settings
from probe.runs.execution import run
from probe.runs.session import Session, journal_path

TOUCHES = 5
OPTIONS: dict[str, dict[str, float]] = {"line": {}, "grbl": {"axis_unit_deg": 0.1}}


def main() -> None:
    cell = pointed(read_cell(library("cells")["arc-welder"]))
    plan = clear_plan(cell, TOUCHES)
    print("ready", flush=True)
    for line in sys.stdin:
        child = os.fork()
        if child:
            print(child, flush=True)
            os.waitpid(child, 0)
            print("ended", flush=True)
            continue
        try:
            port, protocol, folder, scale = line.split()
            once(port, protocol, Path(folder), Clock(float(scale)), cell, plan)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(0)


def once(port: str, protocol: str, folder: Path, clock: Clock, cell: Cell, plan: Plan) -> None:
    path = folder / "touches.csv"
    with Session(path, cell, plan, resume=journal_path(path).exists(), clock=clock) as session:
        controller = open_controller(port, protocol, cell.robot, clock=clock, **OPTIONS[protocol])
        run(plan, controller, session, Settings(search_speed=10.0), clock=clock)
    (folder / "done").touch()


if __name__ == "__main__":
    main()
