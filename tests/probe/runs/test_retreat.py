"""The way back from wherever a motion ended."""

from dataclasses import replace

import numpy as np
import pytest
from run_bench import USUAL, Bench

from probe.line.controller import Contact, LinkLost, Refused, State, TouchError
from probe.motion.joint_path import Geometry
from probe.runs import events
from probe.runs.execution import retreat
from probe.runs.session import Session

pytestmark = [pytest.mark.usefixtures("unsynced"), pytest.mark.xdist_group("runs bench")]


def test_the_sensing_signal_is_waited_for_and_a_stuck_one_stops_the_run(bench: Bench) -> None:
    bench.world.hold = 0.5
    assert bench.run(plan=bench.plan).hits == 8
    assert any(isinstance(event, events.Waiting) for event in bench.told)


def test_an_input_that_stays_closed_gives_no_touch_neither_now_nor_after_a_resume(bench: Bench) -> None:
    """The defect: the latch of a stuck input, in the journal, became a hit 25 mm off the face when the run went on."""

    def weld(kind: str, end: np.ndarray) -> object:
        start = bench.world.q
        bench.world.go(end, 0.1)
        bench.world.stuck = True
        late = 0.001 * (end - start)
        return Contact(bench.world.q - late, bench.world.q.copy(), bench.world.boot, bench.robot.last)

    bench.robot.fail = [None, weld]
    with pytest.raises(TouchError, match="still closed 2 s after"):
        bench.run()
    assert bench.status() == {}

    bench.world.stuck = False

    assert bench.run().hits == 8
    assert len(bench.world.truth) == 8  # the first one was made again
    worst = [min(np.abs(q - truth).max() for truth in bench.world.truth) for q in bench.hits().q]
    assert max(worst) < np.radians(0.02)


def test_an_approach_that_touches_itself_is_left_a_little_further_back(bench: Bench) -> None:
    original, geometry = bench.robot.state, Geometry(bench.cell, USUAL)

    def bridged() -> State:  # molten metal at the wire keeps the contact closed up to 30 mm from the first contact
        state = original()
        near = bool(bench.world.truth) and geometry.length(state.q, bench.world.truth[0]) < 30.0
        return replace(state, contact=state.contact or near)

    bench.robot.state = bridged  # type: ignore[method-assign]

    assert bench.run().hits == 8
    farthest = max(geometry.length(end, bench.world.truth[0]) for _, end in bench.world.motions[:4])
    planned = geometry.length(bench.plan.approach[0], bench.world.truth[0])
    assert planned < 30.0
    assert farthest == pytest.approx(planned + 10.0, abs=0.5)


def test_something_in_the_way_of_a_move_sends_the_robot_back_where_the_move_began(bench: Bench) -> None:
    def block(kind: str, end: np.ndarray) -> object:
        bench.world.go(end, 0.5)
        raise Refused("EARLY")

    bench.robot.fail = [None, None, None, block, None, block]

    assert bench.run().hits == 7
    assert bench.status()["t002"] == "early"
    assert len(bench.reasons()) == 2
    assert bench.only_back_after(4)


@pytest.mark.parametrize("error", [LinkLost("gone"), KeyboardInterrupt()])
@pytest.mark.parametrize("motion", range(1, 8))
def test_an_interruption_anywhere_loses_nothing_and_the_first_motion_after_it_is_back(
    bench: Bench, motion: int, error: BaseException
) -> None:
    def broken(kind: str, end: np.ndarray) -> object:
        hit = bench.world.first_contact(bench.world.q, end)
        bench.world.go(end, min(0.4, 0.9 * (hit or 1.0)) if not bench.world.touching() else 0.4)
        raise error

    bench.robot.fail = [*[None] * motion, broken]
    with pytest.raises(type(error)):
        bench.run()
    made = len(bench.world.motions)

    finished = bench.run()

    assert finished.hits == 8
    assert list(bench.status()) == list(bench.plan.ids)
    assert bench.only_back_after(made)
    assert ("stop" in bench.robot.log) == isinstance(error, KeyboardInterrupt)


def test_after_ctrl_c_the_robot_can_be_sent_back_to_its_approach(bench: Bench) -> None:
    def interrupted(kind: str, end: np.ndarray) -> object:
        bench.world.go(end, 0.2)
        raise KeyboardInterrupt

    bench.robot.fail = [None, interrupted]
    with pytest.raises(KeyboardInterrupt):
        bench.run()

    with Session(bench.path, bench.cell, bench.plan, resume=True) as session:
        retreat(bench.robot, session, USUAL, clock=bench.clock)

    np.testing.assert_allclose(bench.world.q, bench.plan.approach[0], atol=1e-9)
    assert bench.run().hits == 8


def test_a_robot_that_somebody_moved_is_not_moved_without_asking(bench: Bench) -> None:
    bench.robot.fail = [*[None] * 7, LinkLost("gone")]
    with pytest.raises(LinkLost):
        bench.run()
    bench.world.q = bench.world.q + 0.05
    before = len(bench.robot.log)

    with pytest.raises(TouchError, match="somebody has moved it"):
        bench.run()

    assert len(bench.robot.log) == before
