"""The robot of the virtual cell: it moves in time, touches the jig where it truly is, and stops like a controller."""

from itertools import pairwise

import numpy as np
import pytest
from virtual_robots import robot_at, tip
from virtual_support import with_effects

from probe.virtual.batch import search_end, touch_batch
from probe.virtual.robot import VirtualRobot
from probe.virtual.truth import Truth

FAST, SLOW = np.radians(60), np.radians(0.6)


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


def test_nobody_having_moved_it_the_robot_stands_in_the_air_above_the_jig(arc_welder, exact, rng):
    robot = VirtualRobot(arc_welder, exact, rng)

    above = tip(arc_welder, robot.q)
    assert above[2] > 300
    assert (above[:2] > 50).all()
    assert (above[:2] < [350, 250]).all()
    assert not robot.contact


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
