"""The virtual cell behind its port: time, mishaps to order, and what was executed told apart from what was heard."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from raw_host import RawHost, angles, crc, field, joints, line
from virtual_support import with_effects

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.touch import Plan
from probe.virtual.batch import search_end
from probe.virtual.faults import KINDS, SPOILS, Faults, parse_fault, spoil
from probe.virtual.server import VirtualCell, serve
from probe.virtual.truth import Truth

FASTEST = float("inf")


@contextmanager
def served(cell: Cell, plan: Plan, **options: Any) -> Iterator[tuple[VirtualCell, RawHost]]:
    """The nominal robot at the first approach, and a host that has said HELLO."""
    truth = with_effects(Truth(cell.theta), sigma=0.0)
    with serve(cell, truth, start=plan.approach[0], **({"speed": FASTEST} | options)) as virtual:
        host = RawHost(virtual.url)
        try:
            if options.get("protocol") != "grbl" and not options.get("faults"):
                host.say("0 HELLO test")
            yield virtual, host
        finally:
            host.close()


def insist(host: RawHost, number: int, body: str, seconds: float = 0.06) -> str:
    """A stop-and-wait host that says the same again until the last answer of its command comes."""
    for _ in range(300):
        host.send(b"\n" + line(f"{number} {body}"))  # the newline ends what noise has begun
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0:
            try:
                text, _, check = host.read(left).rpartition("*")
            except TimeoutError:
                break
            words = text.split()
            if check == crc(text) and words[0] == str(number) and words[1] != "ACK" and "BUSY" not in words:
                return text
    raise AssertionError(f"no answer to {number} {body}")


@pytest.mark.parametrize("port", ["pty", "socket"])
def test_touches_are_made_over_a_real_port(arc_welder, plan, port):
    end = search_end(arc_welder, plan)[0]
    with served(arc_welder, plan, port=port) as (virtual, host):
        for n in range(1, 11, 2):
            assert host.say(f"{n} SEARCH {joints(end)} 0.6") == f"{n} ACK"
            contact = host.hear()
            host.say(f"{n + 1} MOVE {joints(plan.approach[0])} 20")
            assert host.hear().startswith(f"{n + 1} OK")
            assert angles(contact) == pytest.approx(virtual.robot.touches[-1].latch, abs=1e-8)

    assert len(virtual.robot.touches) == 5
    assert [c[1] for c in virtual.controller.commands] == list(range(1, 11))


def test_the_same_seed_gives_the_same_answers_whatever_the_port(arc_welder, plan):
    heard = []
    for port in ("pty", "socket"):
        truth, end = Truth(arc_welder.theta), search_end(arc_welder, plan)[0]
        with serve(arc_welder, truth, start=plan.approach[0], speed=FASTEST, seed=7, port=port) as virtual:
            host = RawHost(virtual.url)
            heard.append([host.say("0 HELLO a"), host.say(f"1 SEARCH {joints(end)} 0.6"), host.hear()])
            host.close()

    assert heard[0] == heard[1]


def test_in_real_time_a_motion_lasts_as_long_as_it_should(arc_welder, plan):
    target = plan.approach[0] + np.radians([2.0, 0, 0, 0, 0, 0])
    with served(arc_welder, plan, speed=10.0) as (_, host):
        began = time.monotonic()
        host.say(f"1 MOVE {joints(target)} 1")
        host.hear()
        lasted = time.monotonic() - began

    assert lasted >= 0.2  # two seconds at 1 deg/s, ten times as fast; a busy machine may take longer


@pytest.mark.parametrize("kind", SPOILS)
def test_each_way_to_spoil_a_line_executes_every_command_once_and_in_order(arc_welder, plan, kind):
    end = search_end(arc_welder, plan)[0]
    with served(arc_welder, plan, faults=[f"{kind}:0.3"], seed=3) as (virtual, host):
        insist(host, 0, "HELLO a")
        answers = []
        for n in range(1, 9, 2):
            answers.append(insist(host, n, f"SEARCH {joints(end)} 0.6"))
            insist(host, n + 1, f"MOVE {joints(plan.approach[0])} 20")

    assert {happened for happened, _, _ in virtual.faults.happened} == {kind}
    assert [number for _, number, _ in virtual.controller.commands] == list(range(1, 9))
    assert [m.kind for m in virtual.robot.executed] == ["SEARCH", "MOVE"] * 4
    latches = np.array([t.latch for t in virtual.robot.touches])
    assert np.array([angles(a) for a in answers]) == pytest.approx(latches, abs=1e-8)


@pytest.mark.parametrize("port", ["pty", "socket"])
def test_a_cable_pulled_in_a_search_stops_the_robot_within_its_deadman_and_comes_back(arc_welder, plan, port):
    end = search_end(arc_welder, plan)[0]
    options = {"faults": ["unplug@1,fraction=0.2,seconds=2"], "port": port, "speed": 5.0, "deadman": 0.75}
    with served(arc_welder, plan, **options) as (virtual, host):
        insist(host, 0, "HELLO a")
        host.say(f"1 SEARCH {joints(end)} 0.6")
        pulled = 0.2 * virtual.robot.expected[1]
        with pytest.raises(OSError):  # noqa: PT011 - EIO from a pseudo-terminal, an end of file from a socket
            beat_until_gone(host)
        again = reopened(virtual.url)
        hello = again.say("0 HELLO back")
        answer = insist(again, 1, f"SEARCH {joints(end)} 0.6")
        again.close()

    assert field(hello, "last") == "1"
    assert answer.startswith("1 ERR DEADMAN")
    (motion,) = virtual.robot.executed
    assert motion.outcome.kind == "DEADMAN"
    assert motion.ended - motion.began < pulled + 0.75 + 0.3


def beat_until_gone(host: RawHost) -> None:
    while True:
        host.send(b"! HB\n")
        time.sleep(0.02)
        while not host.silent(0.0):
            host.read()


def reopened(url: str) -> RawHost:
    for _ in range(200):
        try:
            return RawHost(url)
        except OSError:
            time.sleep(0.02)
    raise AssertionError(f"{url} has not come back")


def test_a_reboot_in_a_search_stops_it_forgets_it_and_waits_for_hello(arc_welder, plan):
    end = search_end(arc_welder, plan)[0]
    with served(arc_welder, plan, faults=["reboot@1,seconds=0.05"]) as (virtual, host):
        boot = field(insist(host, 0, "HELLO a"), "boot")
        host.say(f"1 SEARCH {joints(end)} 0.6")
        refused = insist(host, 2, "LATCH")
        hello = insist(host, 0, "HELLO b")

    assert refused.startswith("2 ERR OLDSEQ")
    assert field(hello, "boot") != boot
    assert [m.outcome.kind for m in virtual.robot.executed] == ["STOPPED"]
    assert not virtual.robot.touches


def test_a_reboot_that_loses_the_position_says_so(arc_welder, plan):
    end = search_end(arc_welder, plan)[0]
    with served(arc_welder, plan, faults=["reboot-lost@1,seconds=0.05"]) as (_, host):
        boot = field(insist(host, 0, "HELLO a"), "boot")
        host.say(f"1 SEARCH {joints(end)} 0.6")
        while boot in insist(host, 0, "HELLO b"):
            pass
        answer = insist(host, 1, f"MOVE {joints(plan.approach[0])} 5")

    assert answer.startswith("1 ERR UNHOMED")


def test_a_controller_that_hangs_is_silent_and_its_deadman_stops_the_robot(arc_welder, plan):
    end = search_end(arc_welder, plan)[0]
    with served(arc_welder, plan, faults=["hang@1,seconds=0.4"]) as (virtual, host):
        insist(host, 0, "HELLO a")
        host.say(f"1 SEARCH {joints(end)} 0.6")
        answer = insist(host, 1, f"SEARCH {joints(end)} 0.6")

    assert answer.startswith(("1 ERR DEADMAN", "1 CONTACT"))
    assert len(virtual.robot.executed) == 1


@pytest.mark.ghost
def test_an_open_wire_feels_nothing_in_its_search_and_everything_in_the_next(arc_welder, plan):
    end, home = search_end(arc_welder, plan)[0], plan.approach[0]
    with served(arc_welder, plan, faults=["open@1"]) as (_, host):
        insist(host, 0, "HELLO a")
        nothing = insist(host, 1, f"SEARCH {joints(end)} 0.6")
        insist(host, 2, f"MOVE {joints(home)} 20")
        contact = insist(host, 3, f"SEARCH {joints(end)} 0.6")

    assert nothing.startswith("1 NOCONTACT")
    assert angles(nothing) == pytest.approx(end, abs=1e-8)
    assert contact.startswith("3 CONTACT")


def test_an_early_contact_ends_the_move_where_it_was_ordered_and_is_gone_after_going_back(arc_welder, plan):
    home = plan.approach[0]
    away = home - 0.5 * (plan.q[0] - home)
    with served(arc_welder, plan, faults=["early@2,fraction=0.7"]) as (virtual, host):
        insist(host, 0, "HELLO a")
        answers = [insist(host, n + 1, f"MOVE {joints((away, home)[n % 2])} 5") for n in range(2)]
        refused = insist(host, 3, f"SEARCH {joints(home)} 5")
        answers += [insist(host, n + 4, f"MOVE {joints((away, home)[n % 2])} 5") for n in range(2)]

    assert [a.split()[1:3] for a in answers if "ERR" in a] == [["ERR", "EARLY"]]
    assert answers[1].startswith("2 ERR EARLY")
    assert refused.split()[1] == "ERR"
    stopped = virtual.robot.executed[1].outcome.stop
    assert np.all(np.abs(stopped - away) > 0.6 * np.abs(home - away))


def test_a_stuck_contact_reads_closed_after_the_retract_until_it_lets_go(arc_welder, plan):
    end, home = search_end(arc_welder, plan)[0], plan.approach[0]
    with served(arc_welder, plan, faults=["stuck@1,seconds=60"], speed=20.0) as (virtual, host):
        insist(host, 0, "HELLO a")
        insist(host, 1, f"SEARCH {joints(end)} 3")
        insist(host, 2, f"MOVE {joints(home)} 20")
        refused = insist(host, 3, f"SEARCH {joints(end)} 3")
        with virtual.lock:
            virtual.at(virtual.clock.now(), lambda: setattr(virtual.robot.health, "stuck", False))
        time.sleep(0.2)
        freed = insist(host, 4, f"SEARCH {joints(end)} 3")

    assert refused.startswith("3 ERR ALREADY")
    assert freed.startswith("4 CONTACT")


def test_an_emergency_stop_and_a_stalled_drive_end_motions_by_their_codes(arc_welder, plan):
    end, home = search_end(arc_welder, plan)[0], plan.approach[0]
    with served(arc_welder, plan, faults=["stall@1", "estop@2,seconds=1e6"]) as (_, host):
        insist(host, 0, "HELLO a")
        stalled = insist(host, 1, f"SEARCH {joints(end)} 0.6")
        stopped = insist(host, 2, f"SEARCH {joints(end)} 0.6")
        refused = insist(host, 3, f"MOVE {joints(home)} 5")

    assert [a.split()[2] for a in (stalled, stopped, refused)] == ["NOTREACHED", "ESTOP", "ESTOP"]


def test_a_second_host_at_the_socket_is_turned_away_and_the_next_one_served(arc_welder, plan):
    with served(arc_welder, plan, port="socket") as (virtual, host):
        second = RawHost(virtual.url)
        with pytest.raises(OSError):  # noqa: PT011 - reset or end of file
            second.say("0 HELLO me-too")
        second.close()
        first = host.say("0 HELLO still-mine")
        host.close()
        third = reopened(virtual.url)
        last = third.say("0 HELLO mine-now")
        third.close()
        host = third

    assert first.startswith("0 OK")
    assert last.startswith("0 OK")


@pytest.mark.parametrize("kind", KINDS)
def test_every_fault_can_be_ordered_by_rate_and_by_number(kind):
    by_rate, by_number = parse_fault(f"{kind}:0.25"), parse_fault(f"{kind}@7,fraction=0.9")

    assert (by_rate.kind, by_rate.rate, by_rate.at) == (kind, 0.25, 0)
    assert (by_number.at, by_number.fraction) == (7, 0.9)


@pytest.mark.parametrize(
    ("text", "cure"),
    [
        ("bit-flop:0.1", "did you mean 'bit-flip'"),
        ("reboot@x", "write reboot:0.05 or reboot@3"),
        ("reboot:1.5", "probability"),
        ("reboot@1,when=2", "options are"),
        ("lost-line:0.1,way=up", "options are"),
    ],
)
def test_a_fault_that_cannot_be_is_refused_with_its_cure(text, cure):
    with pytest.raises(InputError, match=cure):
        parse_fault(text)


def test_spoiling_does_to_a_line_what_its_name_says(rng):
    sent = b"12 LATCH*ABCD\n"

    flipped, lost = spoil("bit-flip", sent, rng), spoil("lost-byte", sent, rng)
    garbage = spoil("garbage", sent, rng)

    assert sum(bin(a ^ b).count("1") for a, b in zip(flipped[0], sent, strict=True)) == 1
    assert len(lost[0]) == len(sent) - 1
    assert (garbage[1], len(garbage[0]) > 0) == (sent, True)
    assert spoil("duplicate", sent, rng) == [sent, sent]
    assert spoil("lost-line", sent, rng) == []


@pytest.mark.ghost  # a wire that feels nothing lets the torch go on into the jig
@pytest.mark.parametrize("seed", range(3))
def test_whatever_goes_wrong_no_command_is_executed_twice_and_no_answer_lies(arc_welder, plan, seed):
    end, home = search_end(arc_welder, plan)[0], plan.approach[0]
    mishaps = ["spoil:0.1", "hang:0.1,seconds=0.1", "stall:0.1", "open:0.1", "bounce:0.3,seconds=0.02", "early:0.1"]
    with served(arc_welder, plan, faults=[*mishaps, "reboot@4,seconds=0.1"], seed=seed) as (virtual, host):
        contacts, issued, number, boot = [], [], 0, field(insist(host, 0, "HELLO a"), "boot")
        goal, early = home, False
        while len(issued) < 24:
            number += 1
            goal = end if goal is home else home  # after an early contact only the way back is free
            body = f"SEARCH {joints(end)} 0.6" if goal is end and not early else f"MOVE {joints(goal)} 20"
            answer = insist(host, number, body)
            early = "ERR EARLY" in answer or "ERR ALREADY" in answer
            if "OLDSEQ" in answer:
                number, boot = 0, field(insist(host, 0, "HELLO b"), "boot")
                continue
            issued.append((boot, number, body))
            contacts += [answer] if "CONTACT boot" in answer else []

    executed = virtual.controller.commands
    assert len(set(executed)) == len(executed)
    assert set(issued) <= set(executed)
    assert len(executed) - len(issued) <= 1  # the one that the reboot swallowed
    assert len(virtual.robot.executed) <= len(executed)
    latches = np.array([t.latch for t in virtual.robot.touches])
    assert contacts
    for answer in contacts:
        assert np.abs(latches - angles(answer)).max(axis=1).min() < 1e-8


def test_paced_bytes_take_the_time_of_their_baud_rate(arc_welder, plan):
    with served(arc_welder, plan, speed=1.0, baud=4800) as (_, host):
        began = time.monotonic()
        answer = host.say("0 HELLO slow")
        lasted = time.monotonic() - began

    assert lasted > 10 * (len(answer) + 20) / 4800


def test_random_faults_hit_as_often_as_asked_and_only_their_way(rng):
    faults = Faults([parse_fault("lost-line:0.05,way=out")], rng)

    arrived = sum(len(faults.lines(b"x\n", "out")) for _ in range(4000))

    assert 4000 - arrived == pytest.approx(200, abs=4 * np.sqrt(190))
    assert sum(len(faults.lines(b"x\n", "in")) for _ in range(1000)) == 1000
