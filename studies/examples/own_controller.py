"""A controller of one's own: TOUCH/1 with slow moves. `probe.line.controller.Controller` says what others need."""

import tempfile
from pathlib import Path

import numpy as np

import identify
import oed
import probe
from probe.controllers import PROTOCOLS
from probe.controllers.line import Line
from probe.line.clock import Clock
from probe.virtual.server import serve


class Collaborative(Line):
    """TOUCH/1 whose joints turn by 30 degrees a second at most."""

    def move(self, q: np.ndarray, rate: float) -> np.ndarray:
        """Move straight to `q`, slowly."""
        return super().move(q, min(rate, np.radians(30)))


def main() -> None:
    """Make three touches of a plan on a virtual cell."""
    PROTOCOLS["collaborative"] = f"{__name__}:Collaborative"
    cell, rng = identify.read_cell(identify.library("cells")["arc-welder"]), np.random.default_rng(0)
    plan = oed.plan(cell, 30, strategy="even", rng=rng, count=1500).plan.take(np.arange(3))
    with serve(cell, probe.draw_truth(cell, rng, scale=0.1), speed=np.inf, start=plan.approach[0]) as virtual:
        controller, clock = probe.open_controller(virtual.url, "collaborative", cell.robot), Clock()
        with probe.Session(Path(tempfile.mkdtemp()) / "touches.csv", cell, plan, clock=clock) as session:
            finished = probe.run(plan, controller, session, probe.Settings(trust_position=True), clock=clock)
        controller.close()
    print(f"{finished.hits} of {finished.total} touches made")


if __name__ == "__main__":
    main()
