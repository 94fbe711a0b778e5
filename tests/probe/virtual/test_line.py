"""The virtual controller's TOUCH/1, byte by byte: what it answers, what it executes, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from raw_host import angles, crc, field, joints, line
from virtual_support import make_plan, with_effects

from identify.model.cell import Cell
from identify.model.io.description import library, read_robot
from identify.model.touch import Plan
from probe.virtual.batch import search_end
from probe.virtual.line import LineController
from probe.virtual.records import Outcome
from probe.virtual.robot import VirtualRobot
from probe.virtual.truth import Truth


@pytest.fixture(scope="module")
def plan(arc_welder: Cell) -> Plan:
    return make_plan(arc_welder, 4)


class Desk:
    """A controller without a port, and the host's bytes and the time in the hand of the test."""

    def __init__(self, cell: Cell, plan: Plan) -> None:
        truth = with_effects(Truth(cell.theta), sigma=0.0)
        self.robot = VirtualRobot(cell, truth, np.random.default_rng(3), start=plan.approach[0])
        self.controller = LineController(self.robot, np.random.default_rng(4))
        self.now = 0.0
        self.home, self.end = plan.approach[0], search_end(cell, plan)[0]

    def bytes(self, data: bytes) -> list[str]:
        """Bytes in, lines out; every CRC judged."""
        texts = [answer.decode().rstrip("\n").rpartition("*") for answer in self.controller.feed(data, self.now)]
        assert all(check == crc(text) for text, _, check in texts)
        return [text for text, _, _ in texts]

    def say(self, text: str) -> str:
        answers = self.bytes(line(text))
        assert len(answers) == 1
        return answers[0]

    def wait(self, seconds: float) -> list[str]:
        """Let time pass, the host beating its heart."""
        answers = []
        for _ in range(int(np.ceil(seconds / 0.2))):
            self.now += 0.2
            answers += [a for a in self.bytes(b"! HB\n") if not a.startswith("!")]
        return answers

    def do(self, text: str) -> str:
        """A motion from its command to its last answer."""
        assert self.say(text) == f"{text.split()[0]} ACK"
        (answer,) = self.wait(120)
        return answer


@pytest.fixture
def desk(arc_welder: Cell, plan: Plan) -> Desk:
    desk = Desk(arc_welder, plan)
    desk.say("0 HELLO first")
    return desk


def test_hello_tells_boot_joints_last_number_and_the_nonce(desk):
    answer = desk.say("0 HELLO x7-3")

    assert answer == f"0 OK TOUCH/1 boot={desk.controller.boot} joints=6 last=0 nonce=x7-3"


def test_the_crc_is_the_ccitt_one(desk):
    assert crc("123456789") == "29B1"  # the check value of CRC-16/CCITT-FALSE in every catalogue
    assert desk.bytes(b"0 HELLO a*" + crc("0 HELLO a").encode() + b"\n")[0].startswith("0 OK")


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # one controller hears them all
def test_a_line_with_any_byte_changed_is_refused_and_nothing_moves(desk, data):
    good = line(f"1 MOVE {joints(desk.home + 0.01)} 5")[:-1]
    at = data.draw(st.integers(0, len(good) - 1))
    byte = data.draw(st.integers(1, 255).filter(lambda b: b != good[at] and b not in b"\n!"))
    begun = desk.robot.begun

    answers = desk.bytes(good[:at] + bytes([byte]) + good[at + 1 :] + b"\n")

    assert answers == ["? NAK"]
    assert desk.robot.begun == begun


def test_a_move_is_acknowledged_and_then_done(desk):
    target = desk.home + 0.02

    answer = desk.do(f"1 MOVE {joints(target)} 5")

    assert answer.startswith("1 OK q=")
    assert angles(answer) == pytest.approx(target, abs=1e-8)


def test_a_search_tells_boot_number_latch_and_stop(desk, plan):
    answer = desk.do(f"1 SEARCH {joints(desk.end)} 0.6")

    assert answer.split()[:2] == ["1", "CONTACT"]
    assert field(answer, "boot") == desk.controller.boot
    assert field(answer, "seq") == "1"
    assert angles(answer) == pytest.approx(desk.robot.touches[0].latch, abs=1e-8)
    assert angles(answer) == pytest.approx(plan.q[0], abs=np.radians(0.6) * 0.002)
    assert angles(answer, "stop") == pytest.approx(desk.robot.q, abs=1e-8)


def test_the_latch_can_be_asked_for_again_until_the_next_start(desk):
    before = desk.say("1 LATCH")
    contact = desk.do(f"2 SEARCH {joints(desk.end)} 0.6")
    desk.do(f"3 MOVE {joints(desk.home)} 5")
    latch = desk.say("4 LATCH")
    desk.controller.restart()
    desk.say("0 HELLO again")

    assert before.startswith("1 ERR NOLATCH")
    assert latch == f"4 OK boot={field(contact, 'boot')} seq=2 q={field(contact, 'q')}"
    assert desk.say("1 LATCH").startswith("1 ERR NOLATCH")


def test_a_search_that_meets_nothing_says_where_it_ended(desk):
    away = desk.home - 0.3 * (desk.end - desk.home)

    answer = desk.do(f"1 SEARCH {joints(away)} 5")

    assert answer.startswith("1 NOCONTACT q=")
    assert angles(answer) == pytest.approx(away, abs=1e-8)


def test_a_number_is_executed_once_and_answered_as_often_as_it_is_asked(desk):
    command = f"1 MOVE {joints(desk.home + 0.02)} 5"

    while_running = [desk.say(command), desk.say(command)]
    (done,) = desk.wait(5)
    afterwards = [desk.say(command), desk.say(f"1 MOVE {joints(desk.home + 0.2)} 5")]

    assert while_running == ["1 ACK", "1 ACK"]
    assert afterwards == [done, done]
    assert len(desk.robot.executed) == 1


def test_another_number_while_one_runs_is_busy_and_can_be_sent_again_later(desk):
    desk.say(f"1 MOVE {joints(desk.home + 0.02)} 5")

    busy = desk.say("2 LATCH")
    desk.wait(5)

    assert busy.startswith("2 ERR BUSY")
    assert desk.say("2 LATCH").startswith("2 ERR NOLATCH")


@pytest.mark.parametrize("number", [1, 2, 4, 9, 65535])
def test_numbers_out_of_turn_are_refused_and_move_nothing(desk, number):
    for n in (1, 2, 3):
        desk.say(f"{n} LATCH")

    answer = desk.say(f"{number} MOVE {joints(desk.home + 0.01)} 5")

    assert answer.startswith(f"{number} ACK" if number == 4 else f"{number} ERR OLDSEQ")
    assert desk.robot.begun == (number == 4)


def test_after_65535_comes_1(desk):
    desk.controller.last = 65534

    answers = [desk.say("65535 LATCH"), desk.say("1 LATCH"), desk.say("0 HELLO z")]

    assert [a.split()[1] for a in answers[:2]] == ["ERR", "ERR"]
    assert field(answers[2], "last") == "1"


def test_before_hello_nothing_is_executed(arc_welder, plan):
    fresh = Desk(arc_welder, plan)

    answer = fresh.say(f"1 MOVE {joints(fresh.home + 0.01)} 5")

    assert answer.startswith("1 ERR OLDSEQ")
    assert fresh.robot.begun == 0


def test_after_a_restart_the_boot_is_new_and_nothing_moves_until_hello(desk):
    old = desk.controller.boot
    desk.say(f"1 MOVE {joints(desk.home + 0.2)} 5")
    desk.controller.restart()

    refused = desk.say(f"2 MOVE {joints(desk.home)} 5")
    hello = desk.say("0 HELLO n")

    assert refused.startswith("2 ERR OLDSEQ")
    assert field(hello, "boot") != old
    assert field(hello, "last") == "0"
    assert not desk.robot.moving
    assert desk.robot.begun == 1


def test_heartbeat_tells_state_probe_and_joints_without_a_crc_of_the_host(desk):
    idle = desk.bytes(b"! HB 7\n")
    desk.say(f"1 MOVE {joints(desk.home + 0.05)} 5")
    running = desk.bytes(b"! HB*" + crc("! HB").encode() + b"\r\n")

    assert idle[0].startswith(f"! ST boot={desk.controller.boot} IDLE seq=0 hb=7 probe=0 q=")
    assert running[0].startswith(f"! ST boot={desk.controller.boot} RUN seq=1 hb=0 probe=0 q=")


def test_a_motion_meant_for_an_earlier_start_is_refused_and_moves_nothing(desk):
    q = joints(desk.home + 0.05)

    assert desk.say(f"1 MOVE {q} 5 boot=0000").startswith("1 ERR BOOT")
    assert desk.say(f"2 MOVE {q} 5 boot={desk.controller.boot}") == "2 ACK"
    assert desk.robot.begun == 1


def test_stop_brakes_and_the_motion_ends_as_stopped(desk):
    away = desk.home - 0.5 * (desk.end - desk.home)
    desk.say(f"1 MOVE {joints(away)} 1")
    assert desk.wait(1) == []

    status = desk.bytes(b"! STOP\n")
    (ended,) = desk.wait(1)

    assert status[0].startswith("! ST")
    assert ended.startswith("1 ERR STOPPED")
    assert np.abs(desk.robot.q - desk.home).max() == pytest.approx(np.radians(1.0), rel=0.02)  # a second at 1 deg/s


def test_without_a_valid_line_the_controller_stops_within_its_deadman(desk):
    desk.say(f"1 SEARCH {joints(desk.end)} 0.6")
    desk.now += 0.2
    desk.bytes(b"! HB\n")
    desk.now += 0.4
    desk.bytes(b"1 SEARCH spoiled*0000\n")  # noise does not feed the deadman
    desk.now += 10

    answers = desk.bytes(line("1 SEARCH again"))

    assert [a.split()[:3] for a in answers] == [["1", "ERR", "DEADMAN"]] * 2
    assert desk.robot.executed[0].ended == pytest.approx(0.95, abs=0.02)


def test_the_deadman_sleeps_while_the_robot_stands(desk):
    desk.now += 100

    assert desk.do(f"1 MOVE {joints(desk.home + 0.02)} 5").startswith("1 OK")


def test_a_touching_wire_refuses_a_search_and_lets_the_retract_go(desk):
    desk.do(f"1 SEARCH {joints(desk.end)} 0.6")

    again = desk.say(f"2 SEARCH {joints(desk.end)} 0.6")
    touching = desk.bytes(b"! HB\n")
    back = desk.do(f"3 MOVE {joints(desk.home)} 5")

    assert again.startswith("2 ERR ALREADY")
    assert field(touching[0], "probe") == "1"
    assert back.startswith("3 OK")
    assert field(desk.bytes(b"! HB\n")[0], "probe") == "0"


def test_an_early_contact_lets_the_robot_go_back_only(desk):
    early = desk.do(f"1 MOVE {joints(desk.end)} 5")
    on, search = desk.say(f"2 MOVE {joints(desk.end)} 5"), desk.say(f"3 SEARCH {joints(desk.home)} 5")
    back = desk.do(f"4 MOVE {joints(desk.home)} 5")
    forward = desk.do(f"5 SEARCH {joints(desk.end)} 0.6")

    assert [a.split()[1:3] for a in (early, on)] == [["ERR", "EARLY"]] * 2
    assert search.split()[2] in ("EARLY", "ALREADY")
    assert back.startswith("4 OK")
    assert forward.startswith("5 CONTACT")


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("MOVE 1,2,3 5", "SYNTAX"),
        ("MOVE 1,2,3,4,5,6", "SYNTAX"),
        ("MOVE 1,2,3,4,5,nan 5", "SYNTAX"),
        ("MOVE 0,0,0,0,0,0 0", "SYNTAX"),
        ("MOVE 0,0,0,0,0,0 -3", "SYNTAX"),
        ("JUMP 0,0,0,0,0,0 3", "SYNTAX"),
        ("LATCH now", "SYNTAX"),
        ("MOVE 0,0,0,0,0,181 3", "LIMIT"),
        ("SEARCH 161,0,0,0,0,0 3", "LIMIT"),
        ("LATCH", "NOLATCH"),
    ],
)
def test_what_cannot_be_done_is_refused_by_its_code_and_moves_nothing(desk, body, code):
    answer = desk.say(f"1 {body}")

    assert answer.split()[:3] == ["1", "ERR", code]
    assert desk.robot.begun == 0


def test_health_is_answered_by_its_code(desk):
    desk.robot.health.estop = True
    pressed = desk.say(f"1 MOVE {joints(desk.home)} 5")
    desk.robot.health.estop, desk.robot.health.homed = False, False
    unhomed = desk.say(f"2 MOVE {joints(desk.home)} 5")
    desk.robot.health.homed = True
    desk.say(f"3 MOVE {joints(desk.home + 0.2)} 5")
    desk.robot.stop("NOTREACHED", "the drives stopped")
    (stalled,) = desk.wait(1)

    assert [a.split()[2] for a in (pressed, unhomed, stalled)] == ["ESTOP", "UNHOMED", "NOTREACHED"]


@pytest.mark.parametrize("noise", [b"\xff\xfe\n", b"*\n", b"hello\n", b"! GO\n", b"1\n", b"x" * 300 + b"\n"])
def test_noise_is_answered_by_nak(desk, noise):
    assert desk.bytes(noise) == ["? NAK"]
    assert desk.bytes(b"\n\r\n") == []
    assert desk.say("0 HELLO still-there").startswith("0 OK")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # one controller hears them all
@given(st.lists(st.binary(max_size=40), max_size=8))
def test_any_bytes_leave_the_controller_answering_and_the_robot_where_it_was(desk, blocks):
    before = desk.robot.q

    for block in blocks:
        desk.bytes(block)
    desk.bytes(b"\n")

    assert desk.say("0 HELLO sound").startswith("0 OK")
    assert np.array_equal(desk.robot.q, before)


@pytest.mark.ghost
@pytest.mark.parametrize("name", library("robots"))
def test_every_robot_of_the_library_moves_at_its_rate_and_no_line_is_too_long(name, arc_welder):
    robot = read_robot(library("robots")[name])
    cell = replace(arc_welder, robot=robot)
    low = np.trunc(0.9 * robot.lower / robot.joint_unit())  # many digits and minus signs
    virtual = VirtualRobot(cell, Truth(cell.theta), np.random.default_rng(1), start=low * robot.joint_unit())
    controller = LineController(virtual, np.random.default_rng(2), deadman=1e9)
    controller.last, controller.greeted = 65533, True
    target = ",".join(f"{value:.6f}" for value in low + 1.123456)

    controller.feed(line(f"65534 MOVE {target} 2"), 0.0)
    (moved,) = controller.advance(100.0)
    contact = controller._line(f"65535 {controller._ended(Outcome('CONTACT', virtual.q, virtual.q))}")

    assert moved.startswith(b"65534 OK q=")
    assert virtual.executed[0].ended == pytest.approx(1.123456 / 2, rel=0.2)  # the ramps take the rest
    assert len(moved) <= 200
    assert len(contact) <= 200
    assert field(contact.decode(), "q").count(".") == len(robot.joints)
