"""A controller that somebody else wrote from the page of TOUCH/1, before the driver, on a hostile line."""

import re
from pathlib import Path

import hostile
import numpy as np
import paper_controller
import pytest
from hostile import Bench, Trial
from hostile_line import Schedule
from paper_controller import CYCLE, PaperController, sealed
from touching import Ticks
from true_world import TrueWorld

from probe.line.controller import LinkLost

LATENCY = 0.002  # [s]
PAGE = Path(paper_controller.__file__).parents[2] / "probe" / "line" / "TOUCH1.md"


class PaperDevice:
    """The controller of the page before the true robot, in ticking time."""

    url = "test://paper"

    def __init__(self, world: TrueWorld, clock: Ticks) -> None:
        self.world, self.clock, self.plugged, self.gone_until, self._cycled = world, clock, True, -1.0, clock.t
        self.controller = PaperController(tuple(np.degrees(world.q).tolist()), self._closed)
        self._moved: tuple[np.ndarray, float, str] | None = None  # from where, since when, which verb

    def _closed(self, q: tuple[float, ...]) -> bool:
        return self.world.reads(self.world.touching(np.radians(q)))

    @property
    def moving(self) -> bool:
        return bool(self.controller.verb)

    def at(self) -> np.ndarray:
        return np.radians(self.controller.q)

    def follow(self) -> None:
        """Let the controller work until now."""
        until = self.clock.t
        while self.moving and self._cycled + CYCLE <= until:
            self._cycled += CYCLE
            self.clock.t = self._cycled  # the input is read at the time of the cycle
            self.controller.cycle()
            self._note()
        self.clock.t = until
        if not self.moving:
            self._cycled = until

    def _note(self) -> None:
        if self.moving and self._moved is None:
            self._moved = self.at(), self.clock.t, self.controller.verb
        elif not self.moving and self._moved is not None:
            start, began, verb = self._moved
            self._moved = None
            self.world.moved(start, self.at(), began, self.clock.t, searching=verb == "SEARCH")

    def press(self) -> None:
        self.follow()

    def reboot(self) -> None:
        self.follow()
        self.controller.start_up()
        self._note()

    def write(self, data: bytes) -> None:
        self._alive()
        for line in data.splitlines(keepends=True):  # one may begin a motion, and the next end it
            self.controller.hear(line)
            self._note()

    def read(self, timeout: float) -> bytes:
        self._alive()
        until = self.clock.t + timeout
        while not self.controller.said and self.clock.t < until:
            self.clock.t = min(until, self.clock.t + (CYCLE if self.moving else timeout))
            self.follow()
        said, self.controller.said = self.controller.said, b""
        self.clock.t += LATENCY if said else 0.0
        return said

    def reopen(self) -> None:
        if self.clock.t < self.gone_until:
            raise LinkLost("the cable is off")
        self.plugged, self.controller.said = True, b""

    def close(self) -> None:
        self.plugged = False

    def _alive(self) -> None:
        self.follow()
        if not self.plugged:
            raise LinkLost("the cable is off")


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench()


def test_a_plan_is_made_by_a_controller_written_from_the_page(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(hostile, "LineDevice", PaperDevice)
    with bench.still(1):
        trial = Trial(bench, Schedule(1, "line"), tmp_path)
        trial.drive()
        trial.judge()

    assert trial.found == []
    assert trial.finished
    assert trial.schedule.happened == []


def test_no_schedule_makes_a_wrong_touch_with_it(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hostile, "LineDevice", PaperDevice)

    broken = {seed: bench.violations(seed, "line") for seed in range(4)}

    assert {seed: texts for seed, texts in broken.items() if texts} == {}


def test_the_checksum_of_the_example_is_right() -> None:
    (example,) = re.findall(r"`([^`*]+)\*([0-9A-F]{4})`", PAGE.read_text())

    assert sealed(example[0]) == f"{example[0]}*{example[1]}\n".encode()
