"""The robot of the virtual cell: it moves in time, touches the jig where it truly is, and stops like a controller."""

from itertools import pairwise

import numpy as np
import pytest
from virtual_support import make_plan

from identify.estimation.selection import with_errors
from identify.model.base_placement import parked
from identify.model.cell import Cell
from identify.model.ik import reach
from identify.model.touch import Plan
from probe.virtual.batch import search_end, touch_batch
from probe.virtual.contact import Paths, first_contact, touching
from probe.virtual.motion import straight
from probe.virtual.robot import VirtualRobot
from probe.virtual.surfaces import surfaces
from probe.virtual.truth import Truth, with_effects

FAST, SLOW = np.radians(60), np.radians(0.6)


@pytest.fixture(scope="module")
def plan(arc_welder: Cell) -> Plan:
    return make_plan(arc_welder, 24)


@pytest.fixture
def exact(arc_welder: Cell) -> Truth:
    """The nominal robot, touching without scatter."""
    return with_effects(Truth(arc_welder.theta), sigma=0.0)


def robot_at(cell: Cell, truth: Truth, plan: Plan, touch: int = 0) -> VirtualRobot:
    return VirtualRobot(cell, truth, np.random.default_rng(5), start=plan.approach[touch])


def tip(cell: Cell, q: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
    return cell.kinematics.tip(q[None], cell.theta if theta is None else theta)[0][0]


def test_the_first_contact_is_the_one_that_a_march_in_small_steps_finds(arc_welder, plan, rng):
    surface, count, steps = surfaces(arc_welder.jig, arc_welder.wire), len(plan), 3000
    start = plan.approach + rng.normal(0, 0.02, plan.q.shape)
    end = start + 2.4 * (plan.q - plan.approach) + rng.normal(0, 0.08, plan.q.shape)
    paths, none = Paths(start, end, arc_welder.theta), np.zeros(count)

    fraction, met, early = first_contact(arc_welder.kinematics, surface, paths, none, 12)

    compared = 0
    for i in np.flatnonzero(~early):
        march = Paths(*(np.repeat(a[i : i + 1], steps, axis=0) for a in (start, end)), arc_welder.theta)
        closed = touching(arc_welder.kinematics, surface, march, np.linspace(0, 1, steps), np.zeros(steps))
        expected = np.argmax(closed) / (steps - 1) if closed.any() else np.inf
        assert (met[i] >= 0) == closed.any()
        assert fraction[i] == pytest.approx(expected, abs=1.5 / steps)
        compared += closed.any()
    assert compared > 5


def test_a_search_latches_on_the_face_within_one_servo_step_of_motion(arc_welder, exact, plan):
    for i in range(len(plan)):
        robot = robot_at(arc_welder, exact, plan, i)

        outcome = robot.search(search_end(arc_welder, plan)[i], SLOW)

        assert outcome.kind == "CONTACT"
        truly = robot.touches[0]
        assert truly.surface == plan.face[i]
        assert 0 <= truly.latched - truly.time <= 0.001 + 1e-12
        assert np.abs(truly.q - plan.q[i]).max() < 1e-6
        assert np.abs(outcome.q - plan.q[i]).max() < SLOW * 0.0011
        assert 0 < np.linalg.norm(tip(arc_welder, outcome.stop) - tip(arc_welder, outcome.q)) < 0.2
        assert robot.contact


def test_in_process_searches_and_the_batch_touch_the_same_places(arc_welder, plan, rng):
    truth = with_effects(Truth(arc_welder.theta + 0.2 * arc_welder.prior * rng.standard_normal(42)), sigma=0.0)
    touches = touch_batch(arc_welder, truth, plan, rng)

    for i in np.flatnonzero(np.array(touches.status) != "early"):
        robot = robot_at(arc_welder, truth, plan, i)
        outcome = robot.search(search_end(arc_welder, plan)[i], SLOW)
        q = robot.touches[0].q if outcome.kind == "CONTACT" else outcome.q
        assert np.abs(q - touches.q[i]).max() < 1e-6


def test_relay_delay_makes_the_latch_late_by_delay_times_speed(arc_welder, exact, plan):
    robot = robot_at(arc_welder, with_effects(exact, relay_delay=0.02), plan)

    robot.search(search_end(arc_welder, plan)[0], SLOW)

    truly = robot.touches[0]
    assert 0.02 <= truly.latched - truly.time < 0.021
    fastest = np.abs(truly.latch - truly.q).max()
    assert fastest == pytest.approx(SLOW * (truly.latched - truly.time), rel=1e-6)


def test_a_touch_runs_search_retract_and_next_search(arc_welder, exact, plan):
    robot = robot_at(arc_welder, with_effects(exact, bounce=0.01), plan)
    end = search_end(arc_welder, plan)[0]

    kinds = [robot.search(end, SLOW).kind, robot.move(plan.approach[0], SLOW).kind, robot.search(end, SLOW).kind]

    assert kinds == ["CONTACT", "OK", "CONTACT"]
    assert [motion.kind for motion in robot.executed] == ["SEARCH", "MOVE", "SEARCH"]
    assert all(a.ended <= b.began for a, b in pairwise(robot.executed))


def test_a_search_that_begins_in_contact_is_refused_without_motion(arc_welder, exact, plan):
    robot = robot_at(arc_welder, exact, plan)
    robot.search(search_end(arc_welder, plan)[0], SLOW)
    stood = robot.q

    outcome = robot.search(search_end(arc_welder, plan)[0], SLOW)

    assert outcome.kind == "ALREADY"
    assert np.array_equal(robot.q, stood)
    assert len(robot.executed) == 1


def test_a_move_into_the_jig_stops_early_and_only_the_way_back_is_open(arc_welder, exact, plan):
    robot = robot_at(arc_welder, exact, plan)
    into = search_end(arc_welder, plan)[0]

    early = robot.move(into, np.radians(5))
    further, sideways = robot.move(into, SLOW), robot.move(robot.q + 0.05, SLOW)
    back = robot.move(plan.approach[0], SLOW)
    again = robot.move(robot.q + 0.01, SLOW)

    assert early.kind == "EARLY"
    assert np.linalg.norm(tip(arc_welder, early.q) - tip(arc_welder, plan.q[0])) < 2
    assert [further.kind, sideways.kind, back.kind, again.kind] == ["EARLY", "EARLY", "OK", "OK"]
    assert [motion.outcome.kind for motion in robot.executed] == ["EARLY", "OK", "OK"]


def test_a_stop_brakes_on_the_line_and_a_contact_while_braking_is_still_latched(arc_welder, exact, plan):
    robot = robot_at(arc_welder, exact, plan)
    end = search_end(arc_welder, plan)[0]
    robot.begin("SEARCH", end, np.radians(20))
    contact = robot._motion.profile.time(robot._motion.trip.closed[0].enter)

    robot.advance(contact - 0.001)
    robot.stop("STOPPED")
    outcome = robot.advance(contact + 1)

    assert outcome.kind == "STOPPED"
    assert len(robot.touches) == 1
    line, step = end - plan.approach[0], outcome.q - plan.approach[0]
    along = step @ line / (line @ line)
    assert 0 < along < 1
    assert np.abs(step - along * line).max() < 1e-12


@pytest.mark.parametrize("rate", [0.5, 5.0, 50.0, 500.0])
def test_a_motion_takes_its_way_at_its_rate_and_never_goes_back(arc_welder, plan, rate):
    robot = arc_welder.robot
    start, end = plan.approach[0], plan.approach[1]

    profile = straight(robot, start, end, np.radians(rate), 2.0)

    times = np.linspace(2.0, profile.end, 2000)
    fraction = np.array([profile.at(t)[0] for t in times])
    speed = np.abs(np.outer(np.gradient(fraction, times), end - start))
    assert fraction[0] == 0
    assert fraction[-1] == pytest.approx(1)
    assert (np.diff(fraction) >= 0).all()
    assert (speed <= robot.speed * (1 + 1e-6)).all()
    assert speed.max() <= np.radians(rate) * (1 + 1e-6)
    assert profile.end - 2.0 >= np.abs(end - start).max() / np.radians(rate)
    assert [profile.time(f) for f in fraction[1:-1:100]] == pytest.approx(times[1:-1:100])


@pytest.mark.ghost
def test_the_contact_reads_what_the_jig_says_wherever_a_robot_is_driven_that_does_not_look(arc_welder, exact, rng):
    corner, surface = np.array([350.0, 250.0, 80.0]), surfaces(arc_welder.jig, arc_welder.wire)
    kinematics, none = arc_welder.kinematics, np.zeros(1)
    seen = set()
    for _ in range(12):
        ends = corner + rng.uniform(-8, 8, (2, 3)) + np.array([[30.0, -30, 0], [-30, 30, 0]])
        start, end = posed(arc_welder, ends)
        robot = VirtualRobot(arc_welder, exact, rng, start=start)
        robot.begin("MOVE", end, SLOW, watch=False)

        for time in np.linspace(0, robot.due, 40)[:-1]:
            robot.advance(time)
            here = Paths(robot.q[None], robot.q[None], arc_welder.theta)
            expected = bool(touching(kinematics, surface, here, none, none)[0])
            assert robot.contact == expected
            seen.add(expected)
        robot.advance(1e9)
        assert not robot.contact

    assert seen == {True, False}


def posed(cell: Cell, tips: np.ndarray) -> np.ndarray:
    """Joint values for tips beside the jig, the torch straight down."""
    down = np.tile(np.diag([1.0, -1.0, -1.0]), (len(tips), 1, 1))
    start = np.tile(parked(cell), (len(tips), 1))
    found = reach(cell.kinematics, cell.theta, tips, down, start, free_roll=True)
    assert found.reached().all()
    return found.q


def test_nobody_having_moved_it_the_robot_stands_in_the_air_above_the_jig(arc_welder, exact, rng):
    robot = VirtualRobot(arc_welder, exact, rng)

    above = tip(arc_welder, robot.q)
    assert above[2] > 300
    assert (above[:2] > 50).all()
    assert (above[:2] < [350, 250]).all()
    assert not robot.contact


def test_backlash_leaves_the_arm_behind_the_encoders_by_half_the_play_on_each_side(arc_welder, exact, plan):
    play = np.radians(0.02)
    robot = robot_at(arc_welder, with_effects(exact, backlash=(0.0, play)), plan)
    there, back = plan.approach[0] + 0.01, plan.approach[0]

    robot.move(there, SLOW)
    ahead = robot.arm.geared - robot.q
    robot.move(back, SLOW)

    assert ahead == pytest.approx(np.full(6, -play / 2))
    assert robot.arm.geared - robot.q == pytest.approx(np.full(6, play / 2))


def test_joint_noise_scatters_contacts_and_is_told_to_the_judge(arc_welder, exact, plan):
    noise, end = np.radians(0.01), search_end(arc_welder, plan)[0]
    robot = robot_at(arc_welder, with_effects(exact, joint_noise=(0.0, noise)), plan)

    for _ in range(60):
        robot.search(end, SLOW)
        robot.move(plan.approach[0], FAST)

    off = np.array([t.arm - t.q for t in robot.touches])
    assert len(off) == 60
    assert np.std(off) == pytest.approx(noise, rel=0.15)
    faces = np.array([tip(arc_welder, t.arm) @ plan.normal[0] for t in robot.touches])
    assert np.ptp(faces) < 0.01  # the arm itself meets the face; only the tilt of the flat end changes


def test_limits_and_a_pressed_emergency_stop_are_refused(arc_welder, exact, plan):
    robot = robot_at(arc_welder, exact, plan)

    limit = robot.move(arc_welder.robot.upper + 0.01, SLOW)
    robot.health.estop = True
    stopped = robot.move(plan.approach[0] + 0.01, SLOW)

    assert [limit.kind, stopped.kind] == ["LIMIT", "ESTOP"]
    assert not robot.executed


def test_a_restart_that_loses_the_position_refuses_to_move_until_homed(arc_welder, exact, plan):
    robot = robot_at(arc_welder, exact, plan)

    robot.restart(keeps_position=False)
    refused, reads = robot.move(np.zeros(6), SLOW), robot.q
    robot.home()

    assert refused.kind == "UNHOMED"
    assert np.array_equal(reads, np.zeros(6))
    assert robot.q == pytest.approx(plan.approach[0])
    assert robot.move(plan.approach[0] + 0.01, SLOW).kind == "OK"


@pytest.mark.ghost
def test_a_broken_wire_feels_nothing_and_a_stuck_contact_feels_always(arc_welder, exact, plan):
    broken, stuck = robot_at(arc_welder, exact, plan), robot_at(arc_welder, exact, plan)
    broken.health.open, stuck.health.stuck = True, True
    end = search_end(arc_welder, plan)[0]

    nothing, always = broken.search(end, SLOW), stuck.search(end, SLOW)

    assert [nothing.kind, always.kind] == ["NOCONTACT", "ALREADY"]
    assert not broken.contact
    assert stuck.contact
    assert stuck.move(plan.approach[0] + 0.001, SLOW).kind == "OK"  # a move that begins in contact is a retract


def test_something_in_the_way_of_a_move_is_felt_and_left_behind_by_going_back(arc_welder, exact, plan):
    robot = robot_at(arc_welder, exact, plan)
    away = plan.approach[0] - 0.5 * (plan.q[0] - plan.approach[0])
    robot.begin("MOVE", away, SLOW)
    robot.obstruct(0.5)

    early = robot.advance(1e9)
    closed, back, opened = robot.contact, robot.move(plan.approach[0], SLOW), robot.contact

    assert early.kind == "EARLY"
    assert [closed, back.kind, opened] == [True, "OK", False]
    assert robot.move(away, SLOW).kind == "OK"


def test_a_bouncing_contact_chatters_after_it_closes_and_settles(arc_welder, exact, plan):
    robot = robot_at(arc_welder, with_effects(exact, bounce=0.05), plan)
    robot.search(search_end(arc_welder, plan)[0], SLOW)
    closed = robot.touches[0].time

    readings = []
    for time in np.arange(robot.time, closed + 0.1, 0.001):
        robot.advance(time)
        readings.append((time - closed, robot.contact))

    assert {contact for since, contact in readings if since < 0.05} == {True, False}
    assert all(contact for since, contact in readings if since > 0.0501)


def test_a_robot_that_truly_bends_touches_where_it_truly_is(arc_welder, plan):
    bending = with_errors(arc_welder, ("compliance", "harmonics"))
    theta = bending.theta.copy()
    theta[bending.robot.parameters.index("j3.sag4")] = np.radians(0.5)
    truth = with_effects(Truth(theta, robot=bending.robot), sigma=0.0)
    robot = robot_at(arc_welder, truth, plan)
    face = arc_welder.jig.by_name[plan.face[0]]

    robot.search(plan.approach[0] + 2.4 * (plan.q[0] - plan.approach[0]), SLOW)

    position, R = bending.kinematics.tip(robot.touches[0].arm[None], theta)
    lean = face.normal @ R[0, :, 2]
    height = face.normal @ position[0] - face.offset - arc_welder.wire.radius * np.sqrt(1 - lean**2)
    assert abs(height) < 0.01  # [mm], what it moves in a servo step
    assert np.linalg.norm(position[0] - tip(arc_welder, robot.touches[0].arm)) > 0.5


@pytest.mark.collides
def test_an_arm_that_hits_the_table_stops_the_robot_and_is_recorded_though_the_wire_is_clear(arc_welder, exact, rng):
    start = parked(arc_welder)
    fallen = start + np.radians([0, 90, 0, 0, 0, 0])  # the upper arm goes down with all that hangs on it
    robot = VirtualRobot(arc_welder, exact, rng, start=start)

    outcome = robot.move(np.clip(fallen, arc_welder.robot.lower, arc_welder.robot.upper), SLOW)

    assert outcome.kind == "ESTOP"
    assert " has hit " in outcome.text
    assert len(robot.collisions) == 1
    assert robot.move(start, SLOW).kind == "ESTOP"  # a person has to look first
