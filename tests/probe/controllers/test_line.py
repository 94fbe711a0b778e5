"""The host's side of TOUCH/1: against a transcript, and against a controller with every fault, in ticking time."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from touching import SERVO, Ticks, World, clear_plan, disturbed, pointed
from touching_line import SPOILS, LineServer, crc, spoiler
from transcripts import read_transcript

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.controllers.line import Line
from probe.line.controller import CODES, Contact, LinkLost, NoContact, Rebooted, Refused

TRANSCRIPT = r"""
0.00 > 0 HELLO 00c0de*E9FB\n
0.01 < 0 OK TOUCH/1 boot=A1B2 joints=6 last=41 nonce=00c0de*CE12\n
0.01 > ! HB 8\n
0.02 < ! ST boot=A1B2 IDLE seq=41 hb=8 probe=0 q=1.0,2.0,3.0,4.0,5.0,6.0*0000\n
0.02 > ! HB 9\n
0.03 < ! ST boot=A1B2 IDLE seq=41 hb=9 probe=0 q=1.0,2.0,3.0,4.0,5.0,6.0*0000\n
0.03 > 42 SEARCH 1.000000,2.000000,3.000000,4.000000,5.000000,7.000000 2.00000 boot=A1B2*0000\n
0.03 < 42 ACK*8F3A\n
0.20 < 42 CONTACT boot=A1B2 seq=42 q=1.0,2.0,3.0,4.0,5.0,6.5 stop=1.0,2.0,3.0,4.0,5.0,6.6*5F8C\n
0.20 > 43 LATCH*DC0B\n
0.21 < 43 OK boot=A1B2 seq=42 q=1.0,2.0,3.0,4.0,5.0,6.5*2B3A\n
"""


BEFORE = 41  # commands that the controller has executed for somebody else


class Replay:
    """A transport that insists on what was sent and gives what was heard; heartbeats may come at any time."""

    url = "test://replay"

    def __init__(self, transcript: str, clock: Ticks) -> None:
        self.script = [(way, self._sealed(line)) for way, line in read_transcript(transcript.strip())]
        self.clock = clock
        self.outbox = b""

    @staticmethod
    def _sealed(line: bytes) -> bytes:
        body, star, _ = line.decode().rpartition("*")
        return crc(body).encode() if star else line

    def write(self, data: bytes) -> None:
        if data != self.script[0][1] and data.startswith(b"! HB "):
            return
        assert self.script.pop(0) == (">", data)

    def read(self, timeout: float) -> bytes:
        self.clock.sleep(max(timeout, 0.001))
        heard = b""
        while self.script and self.script[0][0] == "<":
            heard += self.script.pop(0)[1]
        return heard

    def reopen(self) -> None:
        raise AssertionError("nothing was wrong with the port")

    def close(self) -> None: ...


@pytest.fixture(scope="module")
def cell(arc_welder: Cell) -> Cell:
    return pointed(arc_welder)


@pytest.fixture(scope="module")
def plan(cell: Cell) -> Plan:
    return clear_plan(cell, 6)


def said(call: Callable[..., object], *arguments: object) -> object:
    """What a command brings, or the code with which it is refused."""
    try:
        return call(*arguments)
    except Refused as refusal:
        return refusal.code


class Bench:
    """A line, and the controller at its other end, standing at the first approach."""

    def __init__(self, cell: Cell, plan: Plan, **faults: object) -> None:
        self.clock = Ticks()
        self.world = World(cell, disturbed(cell), self.clock, plan.approach[0])
        self.server = LineServer(self.world, self.clock, **faults)  # type: ignore[arg-type]
        self.server.last = BEFORE
        self.line = Line(self.server, cell.robot, self.clock)
        self.line.connect()
        self.start, self.end = plan.approach[0], plan.approach[0] + 2.0 * (plan.q[0] - plan.approach[0])
        self.rate = self.world.duration(self.start, self.end, 1.0) / 6.0  # so that the search takes 6 s

    def off(self, found: Contact, speed: float = 1.0) -> float:
        """Servo steps between a latch and the truth."""
        truth = min(self.world.truth, key=lambda q: np.abs(q - found.q).max())
        return float(np.abs(found.q - truth).max() / (speed * self.rate * SERVO))

    def motions(self) -> list[str]:
        return [verb for _, _, verb in self.server.executed]


@pytest.fixture
def bench(cell: Cell, plan: Plan) -> Bench:
    return Bench(cell, plan)


def test_the_line_says_and_understands_what_the_protocol_says(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Ticks()
    monkeypatch.setattr("secrets.token_hex", lambda size: "00c0de")
    monkeypatch.setattr("secrets.randbelow", lambda highest: 6)
    replay = Replay(TRANSCRIPT, clock)
    line = Line(replay, cell.robot, clock)

    line.connect()
    found = line.search(np.radians([1.0, 2, 3, 4, 5, 7]), np.radians(2.0))
    latch = line.latch()

    assert isinstance(found, Contact)
    assert latch is not None
    np.testing.assert_allclose(np.degrees([found.q, found.stop, latch.q]).T[5], [6.5, 6.6, 6.5])
    assert (found.boot, found.sequence, latch.boot, latch.sequence) == ("A1B2", 42, "A1B2", 42)
    assert replay.script == []


def test_a_search_brings_back_where_the_wire_touched_within_a_servo_step(bench: Bench) -> None:
    found = bench.line.search(bench.end, bench.rate)

    assert isinstance(found, Contact)
    assert bench.off(found) <= 1 + 1e-3
    np.testing.assert_allclose(bench.world.q, found.stop, atol=1e-8)


def test_a_search_that_meets_nothing_ends_where_it_was_sent(bench: Bench) -> None:
    bench.world.open_wire = True

    found = bench.line.search(bench.end, bench.rate)

    assert isinstance(found, NoContact)
    np.testing.assert_allclose(found.q, bench.end, atol=1e-8)


@pytest.mark.parametrize(
    ("prepare", "code"),
    [
        (lambda bench: setattr(bench.world, "stuck", True), "ALREADY"),
        (lambda bench: setattr(bench.server, "estop", True), "ESTOP"),
        (lambda bench: setattr(bench.server, "homed", False), "UNHOMED"),
    ],
)
def test_a_refusal_tells_its_code_and_its_reason_and_nothing_moves(bench: Bench, prepare: object, code: str) -> None:
    prepare(bench)  # type: ignore[operator]

    with pytest.raises(Refused, match=CODES[code]) as refusal:
        bench.line.search(bench.end, bench.rate)

    assert refusal.value.code == code
    assert bench.world.motions == []


def test_a_contact_during_a_move_stops_it_and_only_the_way_back_is_open(bench: Bench) -> None:
    with pytest.raises(Refused) as refusal:
        bench.line.move(bench.end, bench.rate)
    with pytest.raises(Refused):
        bench.line.move(bench.end, bench.rate)

    assert refusal.value.code == "EARLY"
    np.testing.assert_allclose(bench.line.move(bench.start, bench.rate), bench.start, atol=1e-8)
    assert not bench.line.state().contact


@pytest.mark.parametrize("kind", SPOILS)
@pytest.mark.parametrize("share", [0.05, 0.3])
def test_a_spoiled_line_costs_time_but_neither_a_command_nor_a_digit(
    cell: Cell, plan: Plan, kind: str, share: float
) -> None:
    rng = np.random.default_rng(7)
    bench = Bench(cell, plan, spoil_in=spoiler(rng, share, (kind,)), spoil_out=spoiler(rng, share, (kind,)))
    heard = []

    for _ in range(6):
        heard.append(said(bench.line.move, bench.start, 4 * bench.rate))
        heard.append(said(bench.line.search, bench.end, 4 * bench.rate))

    contacts = [found for found in heard if isinstance(found, Contact)]
    numbers = [number for _, number, _ in bench.server.executed]
    assert numbers == list(range(BEFORE + 1, BEFORE + 13))
    assert len(contacts) >= (6 if share < 0.1 else 2)
    assert all(bench.off(found, 4) <= 1 + 1e-3 for found in contacts)
    assert {code for code in heard if isinstance(code, str)} <= {"DEADMAN"}  # never silently


def test_numbers_run_over_from_the_last_to_one(bench: Bench) -> None:
    bench.server.last = 65534
    bench.line.connect()

    bench.line.move(bench.start, bench.rate)
    bench.line.move(bench.start, bench.rate)

    assert [(number, verb) for _, number, verb in bench.server.executed] == [(65535, "MOVE"), (1, "LATCH"), (2, "MOVE")]
    assert bench.line.sequence == 3


def test_the_robot_stops_by_itself_when_the_cable_is_pulled_and_the_search_is_told_so_after(bench: Bench) -> None:
    bench.server.unplug_after = bench.server.lines + 5  # some heartbeats into the search
    began = bench.clock.t

    with pytest.raises(Refused) as refusal:
        bench.line.search(bench.end, bench.rate)

    assert refusal.value.code == "DEADMAN"
    (motion,) = bench.world.motions
    assert bench.world.duration(*motion, bench.rate) < 5 * 0.25 + 0.75
    assert bench.clock.t - began < bench.server.outage + 3.0
    bench.line.move(bench.start, bench.rate)


def test_a_short_outage_does_not_cost_the_touch(cell: Cell, plan: Plan) -> None:
    bench = Bench(cell, plan)
    bench.server.unplug_after, bench.server.outage = bench.server.lines + 4, 0.2

    assert isinstance(bench.line.search(bench.end, bench.rate), Contact)
    assert bench.motions() == ["SEARCH"]


def test_a_command_lost_with_the_cable_is_said_to_be_lost_and_is_never_executed_late(bench: Bench) -> None:
    bench.server.unplug_after = bench.server.lines + 2  # after the state that a motion begins with: the command itself

    bench.line.state()
    with pytest.raises(Refused) as refusal:
        bench.line.move(bench.end, bench.rate)

    assert refusal.value.code == "LOST"
    assert bench.world.motions == []
    assert bench.motions() == ["LATCH"]  # its number is used up


@pytest.mark.parametrize("lines", [1, 2, 4])
def test_a_restart_is_noticed_whenever_it_happens_once_and_nothing_is_executed_after(bench: Bench, lines: int) -> None:
    bench.server.reboot_after = bench.server.lines + lines

    with pytest.raises(Rebooted, match="position is not trusted"):
        bench.line.search(bench.end, bench.rate)

    assert all(boot == "A1B2" for boot, _, _ in bench.server.executed)
    assert bench.line.state().boot == "A1B3"


@pytest.mark.parametrize("lines", range(1, 7))
def test_a_restart_is_noticed_even_where_both_starts_count_from_one(cell: Cell, plan: Plan, lines: int) -> None:
    bench = Bench(cell, plan)
    bench.server.reset()
    bench.line.connect()
    bench.server.reboot_after = bench.server.lines + lines

    with pytest.raises(Rebooted):
        bench.line.search(bench.end, bench.rate)

    assert all(boot == "A1B2" or verb == "LATCH" for boot, _, verb in bench.server.executed)


@pytest.mark.parametrize("lines", [1, 3])
def test_a_controller_that_hangs_and_comes_back_has_executed_everything_once(bench: Bench, lines: int) -> None:
    bench.server.hang_after, bench.server.outage = bench.server.lines + lines, 3.0

    answer = said(bench.line.search, bench.end, bench.rate)

    assert answer in ("DEADMAN", "LOST")
    assert bench.motions() in (["LATCH"], ["SEARCH"])
    bench.line.move(bench.start, bench.rate)


def test_a_controller_that_stays_silent_is_given_up_in_bounded_time(bench: Bench) -> None:
    bench.server.hang_after, bench.server.outage = bench.server.lines + 1, 1e9
    began = bench.clock.t

    with pytest.raises(LinkLost, match="nothing answers"):
        bench.line.search(bench.end, bench.rate)

    assert bench.clock.t - began < 10.0


def test_stopping_ends_a_motion_wherever_it_is_and_both_sides_still_count_alike(bench: Bench) -> None:
    class Impatient(Exception):
        pass

    def interrupt(line: bytes) -> list[bytes]:
        if b"RUN" in line:
            raise Impatient
        return [line]

    bench.server.spoil_out = interrupt
    with pytest.raises(Impatient):
        bench.line.search(bench.end, bench.rate)
    bench.server.spoil_out = lambda line: [line]

    bench.line.stop()

    assert bench.server.running is None
    (motion,) = bench.world.motions
    assert bench.world.duration(*motion, bench.rate) < 1.0
    bench.line.move(bench.start, bench.rate)
    assert bench.motions() == ["SEARCH", "LATCH", "MOVE"]  # the number after a stop is used up


def test_a_robot_of_another_kind_is_refused_before_it_moves(cell: Cell, bench: Bench) -> None:
    bench.world.q = np.zeros(7)

    with pytest.raises(Refused, match=r"7 joints, the robot of the cell 6"):
        Line(bench.server, cell.robot, bench.clock).connect()

    assert bench.world.motions == []


@given(st.integers(0, 2**32 - 1), st.sampled_from([0, 30, 60, 90]), st.sampled_from([0, 25, 70]))
def test_whatever_happens_on_the_line_commands_executed_are_commands_issued(
    cell: Cell, plan: Plan, seed: int, unplug: int, hang: int
) -> None:
    rng = np.random.default_rng(seed)
    spoil = spoiler(rng, 0.1, SPOILS)
    bench = Bench(cell, plan, spoil_in=spoil, spoil_out=spoil)
    bench.server.unplug_after = bench.server.lines + unplug if unplug else -1
    bench.server.hang_after = bench.server.lines + hang if hang else -1
    bench.server.outage = float(rng.choice([0.1, 1.0, 3.0]))
    heard = []

    for i in range(8):
        motion, target = (bench.line.move, bench.start) if i % 2 else (bench.line.search, bench.end)
        heard.append(said(motion, target, 4 * bench.rate))

    codes = [code for code in heard if isinstance(code, str)]
    assert set(codes) <= {"DEADMAN", "LOST", "ALREADY", "EARLY"}
    executed = bench.server.executed
    assert [number for _, number, _ in executed] == list(range(BEFORE + 1, BEFORE + 1 + len(executed)))
    assert sum(verb != "LATCH" for _, _, verb in executed) == 8 - codes.count("LOST")
    assert all(bench.off(found, 4) <= 1 + 1e-3 for found in heard if isinstance(found, Contact))
