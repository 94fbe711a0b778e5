"""A rehearsal begins with a robot that stands, is homed and touches nothing; else nothing moves."""

from dataclasses import replace

import pytest
from run_bench import USUAL, Bench

from probe.line.controller import NotReady
from probe.runs.rehearsal import rehearse

pytestmark = [pytest.mark.usefixtures("unsynced"), pytest.mark.xdist_group("runs bench")]


@pytest.mark.parametrize(
    ("state", "sentence"),
    [
        ({"moving": True}, "the robot is moving; wait until it stands"),
        ({"homed": False}, "the machine is not homed; home it"),
        ({"contact": True}, "the touch input is closed before the first motion"),
    ],
)
def test_a_robot_that_is_not_ready_is_not_moved(bench: Bench, state: dict[str, bool], sentence: str) -> None:
    usual = bench.robot.state
    bench.robot.state = lambda: replace(usual(), **state)  # type: ignore[method-assign]

    with pytest.raises(NotReady, match=sentence):
        rehearse(bench.plan, bench.robot, bench.cell, USUAL, clock=bench.clock)

    assert bench.robot.log == []
