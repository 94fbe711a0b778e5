"""The run of a plan against a robot without a line: what is checked, made, repeated, refused, and picked up again."""

import errno
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from touching import SERVO, Direct, Ticks, World, clear_plan, disturbed, pointed

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.tables import read_touches
from identify.model.touch import Plan, Touches
from probe.line.controller import Contact, InTheWay, LinkLost, NoContact, Rebooted, Refused, State, TouchError
from probe.motion.joint_path import Geometry
from probe.motion.room import Room
from probe.motion.settings import Settings
from probe.runs import events
from probe.runs.acceptance import objection, unconfirmed
from probe.runs.delay import estimate_delay, without_delay
from probe.runs.execution import retreat, run
from probe.runs.journal import Journal, unwritable
from probe.runs.prediction import Predictor
from probe.runs.preflight import validate
from probe.runs.records import APPROACH, CONTACT, RETRACTED, Intent, Observation
from probe.runs.rehearsal import rehearse
from probe.runs.session import Session, journal_path

pytestmark = pytest.mark.usefixtures("unsynced")
USUAL = Settings(search_speed=10.0)
Block = Callable[[Callable[[np.ndarray], bool]], None]


@pytest.fixture(scope="module")
def cell(arc_welder: Cell) -> Cell:
    return pointed(arc_welder)


@pytest.fixture(scope="module")
def plan(cell: Cell) -> Plan:
    return clear_plan(cell, 8)


class Bench:
    """A robot before the jig, a session on the disk, and what was told."""

    def __init__(self, cell: Cell, plan: Plan, folder: Path) -> None:
        self.cell, self.plan, self.path = cell, plan, folder / "touches.csv"
        self.clock = Ticks()
        self.world = World(cell, disturbed(cell), self.clock, plan.approach[0])
        self.robot = Direct(self.world)
        self.told: list[events.Event] = []

    def run(self, settings: Settings = USUAL, plan: Plan | None = None) -> events.Finished:
        plan, resume = plan or self.plan, journal_path(self.path).exists()
        with Session(self.path, self.cell, plan, resume=resume, clock=self.clock) as session:
            return run(plan, self.robot, session, settings, tell=self.told.append, clock=self.clock)

    def status(self) -> dict[str, str]:
        rows = [line.split(",") for line in self.path.read_text().splitlines()[1:]]
        return {row[0]: row[2] for row in rows}

    def hits(self) -> Touches:
        return read_touches(self.path, self.cell)

    def reasons(self) -> list[str]:
        return [event.reason for event in self.told if isinstance(event, events.Retried)]

    def only_back_after(self, count: int) -> bool:
        """Whether the first motion after `count` motions led along the last one to the approach where it was safe."""
        (start, end), (again, back) = self.world.motions[count - 1 : count + 1]
        line = (start - end) / np.linalg.norm(start - end)
        on_line = np.abs(back - again - (back - again) @ line * line).max() < 1e-6
        return bool(on_line and np.abs(self.plan.approach - back).max(axis=1).min() < 1e-6)


@pytest.fixture
def bench(cell: Cell, plan: Plan, tmp_path: Path) -> Bench:
    return Bench(cell, plan, tmp_path)


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


def test_the_prediction_sharpens_as_touches_come_in(cell: Cell) -> None:
    plan = clear_plan(cell, 40, seed=2)
    clock = Ticks()
    world, predictor = World(cell, disturbed(cell, 0.5), clock, plan.approach[0]), Predictor(cell)
    assert cell.jig is not None
    surprises = []

    for start, q, face in zip(plan.approach, plan.q, plan.face, strict=True):
        hit = world.first_contact(start, start + 3 * (q - start))
        assert hit is not None
        touched = start + 3 * hit * (q - start)
        surprises.append(predictor.judge(touched, cell.jig.by_name[face]))
        predictor.learn(touched, cell.jig.by_name[face])

    normalized = np.array([s.difference / s.expected for s in surprises])
    assert max(abs(s.residual) for s in surprises) > 10  # what the nominal model says
    assert np.median([abs(s.difference) for s in surprises[-10:]]) < 1.0
    assert np.abs(normalized).max() < 4  # and it knows how well it knows


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda plan: replace(plan, face=("roof", *plan.face[1:])), "has no face 'roof'"),
        (lambda plan: replace(plan, q=plan.q + np.eye(6)[5] * 2 * np.pi), "limits of this robot"),
        (lambda plan: replace(plan, normal=np.roll(plan.normal, 1, axis=1)), "for another jig"),
        (lambda plan: replace(plan, point=plan.point + 200.0), "for another robot or cell"),
        (lambda plan: replace(plan, approach=plan.q + 0.05 * (plan.approach - plan.q)), "before the face"),
        (lambda plan: replace(plan, approach=plan.q + 3.0 * (plan.approach - plan.q)), "further than travel_mm"),
    ],
)
def test_a_plan_that_does_not_fit_is_refused_before_anything_moves(
    bench: Bench, change: Callable[[Plan], Plan], sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        bench.run(plan=change(bench.plan))

    assert bench.robot.log == []


def test_a_plan_that_goes_where_arm_or_torch_hit_is_refused_with_touch_bodies_and_place(bench: Bench) -> None:
    plan, jig = bench.plan, bench.cell.jig
    assert jig is not None
    low = next(i for i, face in enumerate(plan.face) if jig.by_name[face].normal[2] == 1)
    deep = plan.approach[low] + 6 * (plan.q[low] - plan.approach[low])  # on along the search, far into the jig
    via = np.full((len(plan), 1, 6), np.nan)
    via[low, 0] = deep

    with pytest.raises(InputError, match=rf"touch '{plan.ids[low]}': .* and box \d meet near \(.*\) mm; plan again"):
        bench.run(plan=replace(plan, via=via))

    assert bench.robot.log == []


def test_where_no_clear_way_leads_on_the_plan_is_refused(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, geometry = clear_plan(bench.cell, 30, seed=3), Geometry(bench.cell, USUAL)
    pairs = ((i, j) for i in range(30) for j in range(30) if i != j)
    crossing = next(pair for pair in pairs if hidden(geometry, plan.approach[list(pair)]))
    monkeypatch.setattr("probe.motion.roadmap.lifts", lambda edges, q: np.full_like(q, np.nan))  # no way over it

    with pytest.raises(InputError, match=r"no clear way was found from touch .* meet near \("):
        bench.run(plan=plan.take(np.array(crossing)))

    assert bench.robot.log == []


def test_where_the_jig_lies_between_the_robot_goes_round(bench: Bench, cell: Cell) -> None:
    plan, geometry = clear_plan(cell, 30, seed=3), Geometry(cell, USUAL)
    at, first = next((i, j) for i in range(30) for j in range(24) if hidden(geometry, plan.approach[[i, j]]))
    bench.world.q = plan.approach[at].copy()

    finished = bench.run(plan=plan.take(np.arange(first, 30)))

    assert finished.hits == 30 - first
    assert not any(hidden(geometry, np.stack(motion)) for motion in bench.world.motions if far(geometry, *motion))


def hidden(geometry: Geometry, ends: np.ndarray) -> bool:
    """Whether a finer look finds the tip in the jig between two postures."""
    tip = geometry.tip(ends[0] + np.linspace(0, 1, 500)[:, None] * (ends[1] - ends[0]))
    assert geometry.cell.jig is not None
    return any(((tip > box.lower) & (tip < box.upper)).all(axis=1).any() for box in geometry.cell.jig.boxes)


@pytest.fixture
def block(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[np.ndarray], bool]], None]:
    """Take the ways to some postures out of the room."""
    route = Room.route

    def block(blocked: Callable[[np.ndarray], bool]) -> None:
        def routed(room: Room, start: np.ndarray, goal: np.ndarray, via: Sequence[np.ndarray] = ()) -> list[np.ndarray]:
            return [] if blocked(goal) else route(room, start, goal, via)

        monkeypatch.setattr(Room, "route", routed)

    return block


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


def far(geometry: Geometry, start: np.ndarray, end: np.ndarray) -> bool:
    """Whether a motion is longer than a search."""
    return geometry.length(start, end) > 80


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (Settings(override=0.0), "override is 0"),
        (Settings(search_speed=-1.0), "search_speed is -1"),
        (Settings(search_speed=2000.0), "search slower"),
        (Settings(retries=-1), "-1 retries"),
    ],
)
def test_settings_that_make_no_sense_are_refused(bench: Bench, settings: Settings, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        bench.run(settings)

    assert bench.robot.log == []


def test_a_plan_for_a_robot_with_fewer_joints_is_refused(cell: Cell, plan: Plan) -> None:
    with pytest.raises(InputError, match="for 5 joints, the robot 'arc-welder' has 6"):
        validate(replace(plan, q=plan.q[:, :5], approach=plan.approach[:, :5], via=plan.via[..., :5]), cell, USUAL)


def test_every_mistake_of_a_plan_is_told_at_once(cell: Cell, plan: Plan) -> None:
    wrong = replace(plan, normal=np.roll(plan.normal, 1, axis=1))

    with pytest.raises(InputError) as error:
        validate(wrong, cell, USUAL)

    assert len(error.value.mistakes) == len(plan)


def test_a_controller_of_another_robot_is_refused(bench: Bench) -> None:
    bench.robot.joints = 7

    with pytest.raises(InputError, match="moves 7 joints"):
        bench.run()


def test_an_input_that_is_closed_at_the_start_keeps_the_robot_where_it_is(bench: Bench) -> None:
    bench.world.stuck = True

    with pytest.raises(TouchError, match="closed before the first motion"):
        bench.run()

    assert bench.robot.log == []


def test_a_miss_is_tried_again_and_three_in_a_row_end_the_run(bench: Bench) -> None:
    bench.world.open_wire = True

    with pytest.raises(TouchError, match=r"3 touches in a row failed, the last \(t003\)"):
        bench.run()

    assert bench.status() == {"t001": "miss", "t002": "miss", "t003": "miss"}
    assert bench.robot.log.count("search") == 9
    bench.world.open_wire = False
    assert bench.run().hits == 5


def test_a_single_failure_is_made_good_by_a_retry(bench: Bench) -> None:
    bench.robot.fail = [None, None, None, None, Refused("DEADMAN"), None, None, Refused("NOTREACHED")]

    assert bench.run().hits == 8

    assert len(bench.reasons()) == 2


def wrong_latch(**change: object) -> Callable[[Bench], Callable[[str, np.ndarray], object]]:
    """A search whose answer is right but for something."""

    def order(bench: Bench) -> Callable[[str, np.ndarray], object]:
        def answer(kind: str, end: np.ndarray) -> object:
            start = bench.world.q
            hit = bench.world.first_contact(start, end)
            assert hit is not None
            q = start + hit * (end - start)
            bench.world.go(end, hit + 0.002)
            right = Contact(q, bench.world.q.copy(), bench.world.boot, bench.robot.last)
            return replace(right, **{key: f(right) if callable(f) else f for key, f in change.items()})

        return answer

    return order


@pytest.mark.parametrize(
    ("order", "reason"),
    [
        (wrong_latch(boot="OLD"), "another start"),
        (wrong_latch(sequence=lambda c: c.sequence - 1), "latch is of command"),
        (wrong_latch(q=lambda c: c.q + np.radians([0, 0, 0, 0, 0, 0.05])), "off the line"),
        (wrong_latch(q=lambda c: c.q + 5.0 * (c.q - c.stop)), "past the latch"),
        (wrong_latch(q=lambda c: c.stop + 2 * (c.stop - c.q)), "rest on the line of search behind the latch"),
        (wrong_latch(stop=lambda c: c.stop + np.radians([0, 0, 0, 0, 0.05, 0])), "rest on the line"),
    ],
)
def test_a_touch_that_breaks_a_rule_does_not_count_and_says_which(
    bench: Bench, order: Callable[[Bench], Callable[[str, np.ndarray], object]], reason: str
) -> None:
    bench.robot.fail = [None, order(bench)]

    finished = bench.run(replace(USUAL, stop_time=0.06))

    assert finished.hits == 8
    assert len(bench.reasons()) == 1
    assert reason in bench.reasons()[0]


def test_latches_outside_the_search_are_refused(cell: Cell, plan: Plan) -> None:
    geometry = Geometry(cell, USUAL)
    assert cell.jig is not None
    target = geometry.target(plan, 0, cell.jig)
    rate = geometry.search_rate(target, 10.0)
    intent = Intent("search", "t001", "B", 1, target.approach, target.end, target.approach, rate)

    def at(fraction: float) -> str:
        q = target.approach + fraction * (target.end - target.approach)
        return objection(Contact(q, q, "B", 1), intent, evidence(intent, q), geometry)

    assert at(0.4) == ""
    assert "expected between 0 and 1" in at(-0.01)
    assert "expected between 0 and 1" in at(1.01)


def evidence(search: Intent, contact: np.ndarray) -> dict[str, Observation]:
    """What is seen of a touch that counts, until the robot rests on it."""
    seen = [Observation(APPROACH, "B", search.start, False), Observation(CONTACT, "B", contact, True)]
    return {each.place: each for each in seen}


@pytest.mark.parametrize(
    ("place", "change", "reason"),
    [
        (APPROACH, {"closed": True}, "closed before the search"),
        (APPROACH, {"boot": "C"}, "nothing shows that the robot stood at the approach"),
        (APPROACH, {"q": np.ones(6)}, "did not stand at the approach"),
        (CONTACT, {"closed": False}, "did not last"),
        (CONTACT, {"boot": "C"}, "did not last"),
        (CONTACT, {"q": np.ones(6)}, "did not stay"),
        (RETRACTED, {"closed": True}, "still closed after the retract"),
        (RETRACTED, {"boot": "C"}, "still closed after the retract"),
    ],
)
def test_a_touch_counts_only_with_all_of_its_evidence(
    cell: Cell, plan: Plan, place: str, change: dict[str, object], reason: str
) -> None:
    geometry = Geometry(cell, USUAL)
    assert cell.jig is not None
    target = geometry.target(plan, 0, cell.jig)
    search = Intent(
        "search", "t001", "B", 1, target.approach, target.end, target.approach, geometry.search_rate(target, 10.0)
    )
    q = target.contact
    whole = evidence(search, q) | {RETRACTED: Observation(RETRACTED, "B", target.approach, False)}

    def judge(seen: dict[str, Observation]) -> str:
        return objection(Contact(q, q, "B", 1), search, seen, geometry) or unconfirmed(seen, search)

    assert judge(whole) == ""
    assert reason in judge(whole | {place: replace(whole[place], **change)})
    assert judge({key: value for key, value in whole.items() if key != place}) != ""


def test_a_touch_that_all_others_speak_against_is_made_again(cell: Cell, tmp_path: Path) -> None:
    bench = Bench(cell, clear_plan(cell, 30, seed=2), tmp_path)
    original, wrong = bench.robot.search, list[float]()

    def bent(q: np.ndarray, rate: float) -> Contact | NoContact:
        start, found = bench.world.q, original(q, rate)
        if wrong:
            return found
        wrong.append(1.0)  # the very first touch, which no prediction speaks against yet
        late = found.q + 0.12 * (q - start)
        bench.world.q = late + 1e-6 * (q - start)
        return Contact(late, bench.world.q.copy(), bench.world.boot, bench.robot.last)

    bench.robot.search = bent  # type: ignore[method-assign]

    assert bench.run(replace(USUAL, disagreement=1.0)).hits == 30
    assert any("from what the other touches predict" in reason for reason in bench.reasons())
    assert sorted(bench.status()) == sorted(bench.plan.ids)
    made = dict(zip(bench.hits().ids, bench.hits().q, strict=True))
    first = min(np.abs(made["t001"] - truth).max() for truth in bench.world.truth[1:])
    assert first < 0.01 * SERVO * 50


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


def test_a_contact_that_does_not_last_is_no_touch(bench: Bench) -> None:
    def glitch(kind: str, end: np.ndarray) -> object:
        start = bench.world.q
        bench.world.go(end, 0.2)
        return Contact(start + 0.199 * (end - start), bench.world.q.copy(), bench.world.boot, bench.robot.last)

    bench.robot.fail = [None, glitch]

    assert bench.run().hits == 8
    assert "did not last" in bench.reasons()[0]


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


def test_a_touch_far_from_the_prediction_is_repeated_at_once(cell: Cell, tmp_path: Path) -> None:
    bench = Bench(cell, clear_plan(cell, 30, seed=2), tmp_path)

    original, wrong = bench.robot.search, list[float]()

    def bent(q: np.ndarray, rate: float) -> Contact | NoContact:
        start, found = bench.world.q, original(q, rate)
        if len(bench.world.truth) != 30 or wrong:
            return found
        wrong.append(1.0)  # the wire gives way: what it says comes a quarter of the search too late
        late = found.q + 0.25 * (q - start)
        bench.world.q = late + 1e-6 * (q - start)
        return Contact(late, bench.world.q.copy(), bench.world.boot, bench.robot.last)

    bench.robot.search = bent  # type: ignore[method-assign]

    assert bench.run().hits == 30
    (reason,) = bench.reasons()
    assert "mm from the prediction" in reason
    assert float(reason.split()[0]) < -5.0
    assert bench.hits().note[29] == ""


def test_once_the_robot_is_known_a_search_begins_close_before_its_contact(cell: Cell, tmp_path: Path) -> None:
    bench = Bench(cell, clear_plan(cell, 30, seed=2), tmp_path)
    original, starts = bench.robot.search, list[np.ndarray]()

    def noted(q: np.ndarray, rate: float) -> Contact | NoContact:
        starts.append(bench.world.q)
        return original(q, rate)

    bench.robot.search = noted  # type: ignore[method-assign]

    assert bench.run().hits == 30
    tips = cell.kinematics.tip(np.stack([*starts, *bench.world.truth]), bench.world.theta)[0].reshape(2, 30, 3)
    way = np.linalg.norm(tips[0] - tips[1], axis=1)  # [mm]
    assert way[:3].min() > 15
    assert way[-5:].max() < 12
    assert way.min() > 2
    assert bench.reasons() == []


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


def test_the_override_slows_everything_but_the_search(bench: Bench, cell: Cell, plan: Plan, tmp_path: Path) -> None:
    rates: dict[float, list[tuple[str, float]]] = {}
    for override in (1.0, 0.5):
        other = Bench(cell, plan, tmp_path / str(override))
        other.path.parent.mkdir()
        heard = rates.setdefault(override, [])
        move, search = other.robot.move, other.robot.search
        other.robot.move = lambda q, r, h=heard, m=move: (h.append(("move", r)), m(q, r))[1]  # type: ignore[method-assign]
        other.robot.search = lambda q, r, h=heard, s=search: (h.append(("search", r)), s(q, r))[1]  # type: ignore[method-assign]
        other.run(replace(USUAL, override=override))

    fast, slow = rates[1.0][1:], rates[0.5][1:]
    assert [kind for kind, _ in fast] == [kind for kind, _ in slow]
    for (kind, f), (_, s) in zip(fast, slow, strict=True):
        assert s == pytest.approx(f if kind == "search" else f / 2, rel=2e-2)


def test_no_joint_and_no_tip_moves_faster_than_allowed(bench: Bench) -> None:
    robot, geometry = bench.cell.robot, Geometry(bench.cell, USUAL)
    original, worst = bench.robot.move, []

    def watched(q: np.ndarray, rate: float) -> np.ndarray:
        seconds = bench.world.duration(bench.world.q, q, rate)
        if seconds > 0:
            joints = (np.abs(q - bench.world.q) / seconds / robot.speed).max()
            worst.append(max(joints, geometry.length(bench.world.q, q) / seconds / USUAL.move_speed))
        return original(q, rate)

    bench.robot.move = watched  # type: ignore[method-assign]
    bench.run()

    assert max(worst) <= 1.001


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


def test_a_robot_that_somebody_moved_is_not_moved_without_asking(bench: Bench) -> None:
    bench.robot.fail = [*[None] * 7, LinkLost("gone")]
    with pytest.raises(LinkLost):
        bench.run()
    bench.world.q = bench.world.q + 0.05
    before = len(bench.robot.log)

    with pytest.raises(TouchError, match="somebody has moved it"):
        bench.run()

    assert len(bench.robot.log) == before


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
