"""How long touches take by the virtual clock, and how little of a processor the driver needs meanwhile."""

import time
from pathlib import Path

import pytest
from hostile import BACKENDS, Bench, Schedule, Trial
from touching import clear_plan

from probe.motion.settings import Settings

# [min] that 100 touches may take, searched at 10 mm/s; the arm of GRBL accelerates here, and is slowed on short ways so
# that a wrong digit is seen in time; the end of a motion of LinuxCNC is looked at twice
HUNDRED = {"line": 6.1, "grbl": 6.8, "linuxcnc": 6.25}
COUNT = 12
SHARE = 0.05  # of a core


@pytest.fixture(scope="module")
def bench() -> Bench:
    bench = Bench()
    bench.plan = clear_plan(bench.cell, COUNT)
    return bench


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_touch_takes_no_longer_than_it_may_and_hardly_any_of_the_processor(
    bench: Bench, backend: str, tmp_path: Path
) -> None:
    with bench.still(1):
        trial = Trial(bench, Schedule(1, backend), tmp_path)
        trial.once(Settings(search_speed=10.0))  # what can be reckoned once is reckoned here
        trial = Trial(bench, Schedule(1, backend), tmp_path / "again")
        trial.path.parent.mkdir()
        began, used = trial.clock.t, time.process_time()
        trial.once(Settings(search_speed=10.0))
        seconds, used = trial.clock.t - began, time.process_time() - used

    assert seconds / COUNT * 100 <= HUNDRED[backend] * 60
    assert used / seconds < SHARE  # driver, watch and the simulated controller together
