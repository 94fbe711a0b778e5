"""The run of a plan against a robot without a line: what is checked, made, repeated, refused, and picked up again."""

import errno
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from run_bench import USUAL, Bench, hidden
from touching import SERVO, clear_plan

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.touch import Plan
from probe.line.controller import Contact, InTheWay, LinkLost, NoContact, Rebooted, Refused, TouchError
from probe.motion.joint_path import Geometry
from probe.motion.room import Room
from probe.motion.settings import Settings
from probe.runs import events
from probe.runs.delay import estimate_delay, without_delay
from probe.runs.journal import Journal, unwritable
from probe.runs.prediction import Predictor
from probe.runs.rehearsal import rehearse
from probe.runs.session import Session

pytestmark = [pytest.mark.usefixtures("unsynced"), pytest.mark.xdist_group("runs bench")]
Block = Callable[[Callable[[np.ndarray], bool]], None]


def test_every_touch_of_a_plan_is_made_and_right_to_the_servo_step(bench: Bench) -> None:
    finished = bench.run()

    assert (finished.hits, finished.total) == (8, 8)
    hits = bench.hits()
    assert hits.ids == bench.plan.ids
    geometry = Geometry(bench.cell, USUAL)
    for i, (q, truth) in enumerate(zip(hits.q, bench.world.truth, strict=True)):
        assert bench.cell.jig is not None
        target = geometry.target(bench.plan, i, bench.cell.jig)
        step = geometry.search_rate(target, 10.0) * SERVO
        assert np.abs(q - truth).max() <= step * 1.001


def test_a_row_is_on_the_disk_before_the_next_approach_begins(bench: Bench) -> None:
    seen = []
    original = bench.robot.move

    def watched(q: np.ndarray, rate: float) -> np.ndarray:
        seen.append((q, len(bench.path.read_text().splitlines()) - 1))
        return original(q, rate)

    bench.robot.move = watched  # type: ignore[method-assign]
    bench.run()

    for i, approach in enumerate(bench.plan.approach):
        assert i in [rows for q, rows in seen if np.abs(q - approach).max() < 1e-6]
    assert [rows for _, rows in seen] == sorted(rows for _, rows in seen)


def test_the_listener_can_draw_a_table(bench: Bench) -> None:
    bench.run(replace(USUAL, temperature=21.5, note="second shift"))

    touched = [event for event in bench.told if isinstance(event, events.Touched)]
    assert [event.done for event in touched] == list(range(1, 9))
    assert touched[-1].seconds_left == 0
    left = [event.seconds_left for event in touched]
    assert min(left) == 0
    assert left[0] > left[4] > 0
    assert bench.hits().temperature.tolist() == [21.5] * 8
    assert set(bench.hits().note) == {"second shift"}


def test_where_the_jig_lies_between_the_robot_goes_round(bench: Bench, cell: Cell) -> None:
    plan, geometry = clear_plan(cell, 30, seed=3), Geometry(cell, USUAL)
    at, first = next((i, j) for i in range(30) for j in range(24) if hidden(geometry, plan.approach[[i, j]]))
    bench.world.q = plan.approach[at].copy()

    finished = bench.run(plan=plan.take(np.arange(first, 30)))

    assert finished.hits == 30 - first
    assert not any(hidden(geometry, np.stack(motion)) for motion in bench.world.motions if far(geometry, *motion))


def test_a_touch_without_a_clear_way_is_skipped_and_the_others_are_made(bench: Bench, block: Block) -> None:
    nowhere = bench.plan.approach[2]
    block(lambda goal: np.allclose(goal, nowhere))
    bench.world.q = bench.plan.approach[0].copy()

    finished = bench.run()

    assert finished.hits == 7
    assert list(finished.skipped) == ["t003"]
    assert finished.skipped["t003"].startswith("no clear way was found: ")
    assert list(bench.status().items())[-1] == ("t003", "skipped")
    assert not any(np.allclose(end, nowhere) for _, end in bench.world.motions)
    assert bench.run().skipped == finished.skipped  # a later run reads it in the journal


def test_a_touch_to_which_others_open_a_way_is_made_after_them(bench: Bench, block: Block) -> None:
    block(lambda goal: np.allclose(goal, bench.plan.approach[2]) and "t006" not in bench.status())

    assert bench.run().hits == 8
    assert list(bench.status())[-1] == "t003"


@pytest.mark.parametrize("made", [0, 4])
def test_a_robot_that_cannot_get_away_from_where_it_stands_is_not_moved(bench: Bench, block: Block, made: int) -> None:
    block(lambda goal: len(bench.status()) == made)
    bench.world.q = bench.plan.approach[0] + 0.01

    with pytest.raises(InTheWay, match=rf"from where the robot stands to any of the {8 - made} touches left; jog"):
        bench.run()

    assert len(bench.status()) == made
    assert len(bench.world.truth) == made
    np.testing.assert_allclose(bench.world.q, bench.plan.approach[made - 1] if made else bench.world.motions[0][0])


def test_a_robot_from_whose_place_no_way_leads_goes_back_over_the_legs_it_came(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    route, dead_end = Room.route, bench.plan.approach[3]
    monkeypatch.setattr(
        Room, "route", lambda room, a, *rest: [] if np.allclose(a, dead_end, atol=1e-6) else route(room, a, *rest)
    )

    finished = bench.run()

    came_from = next(start for start, end in bench.world.motions if np.allclose(end, dead_end, atol=1e-6))
    assert finished.hits == 8
    assert any(
        np.allclose(np.stack([start, end]), np.stack([dead_end, came_from]), atol=1e-5)
        for start, end in bench.world.motions
    )


def far(geometry: Geometry, start: np.ndarray, end: np.ndarray) -> bool:
    """Whether a motion is longer than a search."""
    return geometry.length(start, end) > 80


def test_an_input_that_is_closed_at_the_start_keeps_the_robot_where_it_is(bench: Bench) -> None:
    bench.world.stuck = True

    with pytest.raises(TouchError, match="closed before the first motion"):
        bench.run()

    assert bench.robot.log == []


def test_a_full_disk_stops_the_run_and_loses_nothing_that_was_measured(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    original, written = Journal.append, list[str]()

    def full(self: Journal, record: dict[str, object]) -> None:
        written.append(str(record["kind"]))
        if len(written) == 23:
            raise unwritable(self.path, OSError(errno.ENOSPC, "No space left on device"))
        original(self, record)

    monkeypatch.setattr(Journal, "append", full)
    with pytest.raises(TouchError, match="make room on the disk"):
        bench.run()
    kept, moved = dict(bench.status()), len(bench.world.motions)

    assert bench.run().hits == 8
    assert kept.items() <= bench.status().items()
    assert bench.only_back_after(moved)


def test_a_point_that_is_found_again_where_nobody_expected_it_is_believed(bench: Bench) -> None:
    target = Predictor(bench.cell)
    assert bench.cell.jig is not None
    bench.run(replace(USUAL, disagreement=-1e6))  # everything is a surprise

    assert all("from the prediction, twice" in note for note in bench.hits().note)
    assert len(bench.world.truth) == 16
    assert target.judge(bench.hits().q[0], bench.cell.jig.by_name[bench.plan.face[0]]).expected > 1.0


def test_the_first_point_is_touched_again_at_intervals_to_see_drift(bench: Bench) -> None:
    bench.run(replace(USUAL, again_every=3))

    drifts = [event for event in bench.told if isinstance(event, events.Drifted)]
    assert len(drifts) == 2
    assert set(bench.status()) == {*bench.plan.ids, *(drift.id for drift in drifts)}
    assert next(name[4:] for name in bench.status() if "~" in name) == "~2"
    assert all(abs(drift.change) < 0.011 for drift in drifts)  # a servo step of 10 mm/s


def test_drift_is_seen_with_its_size_and_sign(bench: Bench) -> None:
    original = bench.robot.search

    def drifting(q: np.ndarray, rate: float) -> Contact | NoContact:
        if len(bench.world.truth) == 4:
            bench.world.theta = bench.world.theta + np.eye(len(bench.world.theta))[2] * 0.2  # the base rises by 0.2 mm
        return original(q, rate)

    bench.robot.search = drifting  # type: ignore[method-assign]
    bench.run(replace(USUAL, again_every=4))

    drift = next(event for event in bench.told if isinstance(event, events.Drifted))
    assert bench.cell.jig is not None
    face = bench.cell.jig.by_name[bench.plan.face[bench.plan.ids.index(drift.id.partition("~")[0])]]
    assert drift.change == pytest.approx(-0.2 * face.normal[2], abs=0.012)  # joints reach as far below as it rose


def test_a_touch_whose_answer_was_lost_is_picked_up_from_the_latch(bench: Bench) -> None:
    original = bench.robot.search

    def deafened(q: np.ndarray, rate: float) -> Contact | NoContact:
        original(q, rate)
        bench.robot.search = original  # type: ignore[method-assign]
        raise LinkLost("gone")

    bench.robot.search = deafened  # type: ignore[method-assign]
    with pytest.raises(LinkLost):
        bench.run()

    assert bench.run().hits == 8
    assert len(bench.world.truth) == 8
    assert bench.hits().note[0] == "picked up after an interruption"


def test_after_a_restart_nothing_moves_until_the_operator_agrees_and_then_a_known_point_is_touched(
    bench: Bench,
) -> None:
    bench.robot.fail = [*[None] * 7, LinkLost("gone")]
    with pytest.raises(LinkLost):
        bench.run()
    bench.world.boot, before = "C3D4", len(bench.robot.log)

    with pytest.raises(Rebooted, match="trust-position"):
        bench.run()
    assert len(bench.robot.log) == before
    finished = bench.run(replace(USUAL, trust_position=True))

    assert finished.hits == 8
    assert len(bench.world.truth) == 9  # one of them made twice
    assert len([event for event in bench.told if isinstance(event, events.Drifted)]) == 1
    assert bench.run().hits == 8  # and from then on the new start is trusted


def test_a_position_that_a_restart_has_moved_is_found_out(bench: Bench) -> None:
    bench.robot.fail = [*[None] * 7, LinkLost("gone")]
    with pytest.raises(LinkLost):
        bench.run()
    bench.world.boot = "C3D4"
    bench.world.theta = bench.world.theta.copy()
    bench.world.theta[:3] += [1.0, 1.0, 1.0]
    made = list(bench.status())

    with pytest.raises(TouchError, match="the position has moved"):
        bench.run(replace(USUAL, trust_position=True))

    assert list(bench.status()) == made
    with pytest.raises(Rebooted):
        bench.run()


@pytest.mark.parametrize("code", ["ESTOP", "STOPPED", "UNHOMED"])
def test_what_a_person_decided_at_the_robot_is_not_overruled(bench: Bench, code: str) -> None:
    bench.robot.fail = [None, None, Refused(code)]

    with pytest.raises(TouchError, match="put that right"):
        bench.run()

    assert bench.robot.log.count("move") + bench.robot.log.count("search") == 3


def test_what_the_controller_will_never_do_is_not_asked_twice(bench: Bench) -> None:
    bench.robot.fail = [None, None, None, Refused("LIMIT", "joint 3")]

    assert bench.run().hits == 7
    assert bench.status()["t002"] == "skipped"
    assert len(bench.reasons()) == 1


def test_a_rehearsal_visits_every_approach_from_further_off_and_touches_nothing(bench: Bench) -> None:
    finished = rehearse(bench.plan, bench.robot, bench.cell, USUAL, clock=bench.clock)

    assert finished.total == 8
    assert "search" not in bench.robot.log
    assert not bench.path.exists()
    normals, tips = (
        bench.plan.normal,
        bench.cell.kinematics.tip(np.array([m[1] for m in bench.world.motions]), bench.cell.theta)[0],
    )
    away = np.einsum("ij,ij->i", normals, tips - bench.plan.point)
    assert (away > 40).all()


def test_a_rehearsal_that_touches_something_goes_back_and_says_so(bench: Bench) -> None:
    def block(kind: str, end: np.ndarray) -> object:
        bench.world.go(end, 0.5)
        raise Refused("EARLY")

    bench.robot.fail = [None, block]

    with pytest.raises(TouchError, match="on the way to touch 't002'"):
        rehearse(bench.plan, bench.robot, bench.cell, USUAL, clock=bench.clock)

    np.testing.assert_allclose(bench.world.motions[2][1], bench.world.motions[1][0], atol=1e-12)  # rounding only


def test_two_speeds_tell_the_delay_of_the_relay_and_it_can_be_taken_out(cell: Cell, tmp_path: Path) -> None:
    plan = clear_plan(cell, 25, seed=4)
    bench = Bench(cell, plan, tmp_path)
    bench.world.delay = 0.0123
    settings = Settings(search_speed=5.0, fast_speed=20.0)

    bench.run(settings)

    with Session(bench.path, cell, plan, resume=True) as session:
        delay = estimate_delay(session.results.values(), cell)
        touches = without_delay(session.results.values(), cell, delay.seconds)
    slow = np.array(bench.world.truth[1::2])
    tips = cell.kinematics.tip(np.vstack([bench.hits().q, touches.q, slow]), bench.world.theta)[0].reshape(3, -1, 3)
    bias = np.einsum("nij,ij->ni", tips[:2] - tips[2], touches.normal).mean(axis=1)  # [mm]
    assert delay.seconds == pytest.approx(
        0.0123 + SERVO / 2, abs=3 * delay.sigma + 5e-5
    )  # a servo step too, on average
    assert delay.pairs == 25
    assert abs(bias[0]) > 0.03
    assert abs(bias[1]) < 0.005
    assert all("set back by" in note for note in touches.note)


def test_a_delay_needs_pairs(cell: Cell, plan: Plan, tmp_path: Path) -> None:
    bench = Bench(cell, plan, tmp_path)
    bench.run()

    with Session(bench.path, cell, plan, resume=True) as session, pytest.raises(InputError, match="at two speeds"):
        estimate_delay(session.results.values(), cell)
