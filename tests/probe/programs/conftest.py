"""One plan, one virtual arm and one live run, shared by all makers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from maker_bench import DELAY, MISSES, PULSES, STICKS, TOUCHES, Bench, Made, make
from maker_machine import LiveController, RobotClock

from identify.model.io.tables import read_plan
from identify.model.joint_counting import JointCounting
from identify.model.touch import Touches
from probe.motion.settings import Settings
from probe.programs.makers import MAKERS
from probe.programs.options import Options
from probe.runs.execution import run
from probe.runs.session import Session
from probe.virtual.truth import Effects, Truth

PLAN = Path(__file__).with_name("plan.csv")  # touchcal plan -n 60 --seed 1 of the library's cell


@pytest.fixture(scope="session")
def bench(arc_welder) -> Bench:
    """An arm off by a fifth of its tolerances, with play, delay, bounce and noise."""
    rng = np.random.default_rng(5)
    counting = JointCounting(pulses=tuple(PULSES), uncoupled=True)
    cell = replace(arc_welder, robot=replace(arc_welder.robot, counting=counting))
    plan = read_plan(PLAN, cell)
    assert len(plan) == TOUCHES
    theta = cell.theta + 0.15 * cell.scale * rng.standard_normal(len(cell.theta))
    effects = Effects(
        sigma=0.03,
        joint_noise=(0.0, np.radians(0.0005)),
        backlash=(0.0, np.radians(0.002)),
        relay_delay=DELAY,
        servo=0.0001,
        bounce=0.003,
    )
    return Bench(cell, plan, Truth(theta, effects))


@pytest.fixture(scope="session")
def live(bench, tmp_path_factory) -> Touches:
    """The touches of a live run, one attempt each, every search from the approach."""
    robot = bench.robot(missing=MISSES)
    settings = Settings(retries=0, misses=TOUCHES, near=1e6, trust_position=True)
    path, clock = tmp_path_factory.mktemp("live") / "touches.csv", RobotClock(robot)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.fsync", lambda handle: None)
        with Session(path, bench.cell, bench.plan, clock=clock) as session:
            run(bench.plan, LiveController(robot), session, settings, clock=clock)
            results = list(session.results.values())
    blank = np.full(len(results), np.nan)
    return Touches(
        tuple(r.id for r in results),
        tuple(r.face for r in results),
        np.array([r.reading.q for r in results]),
        np.full((len(results), 3), np.nan),
        blank,
        blank,
        tuple(r.status for r in results),
        blank,
        ("",) * len(results),
        tuple(r.note for r in results),
        bench.plan.approach,
    )


@pytest.fixture(scope="session")
def made(bench, tmp_path_factory) -> dict[str, Made]:
    """The programs of all makers, run on the same arm: three misses, and an input that sticks once."""
    faults = {"missing": MISSES, "sticks": STICKS}
    options = {"fanuc": Options(first=11, tool="2"), "ur": Options(per_file=25)}
    return {
        maker: make(bench, maker, tmp_path_factory.mktemp(maker), options.get(maker, Options()), **faults)
        for maker in MAKERS
    }
