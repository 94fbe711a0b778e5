"""What a late or repeated line can do to the host of TOUCH/1: nothing. And how long it may take in the worst case."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from touching import Ticks, World, clear_plan, disturbed, pointed
from touching_line import LineServer, crc

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.controllers.line import Line
from probe.line.controller import LinkLost, Refused

RATE = 0.1  # [rad/s]


@pytest.fixture(scope="module")
def cell(arc_welder: Cell) -> Cell:
    return pointed(arc_welder)


@pytest.fixture(scope="module")
def plan(cell: Cell) -> Plan:
    return clear_plan(cell, 6)


class Desk:
    """A host, the controller at its other end, and what was said between them."""

    def __init__(self, cell: Cell, plan: Plan, server: type[LineServer] = LineServer) -> None:
        self.clock, self.said = Ticks(), list[bytes]()
        self.world = World(cell, disturbed(cell), self.clock, plan.approach[0])
        self.server = server(self.world, self.clock, spoil_out=self._out)
        self.change: Callable[[bytes], list[bytes]] = lambda line: [line]
        self.line = Line(self.server, cell.robot, self.clock)
        self.start, self.far = plan.approach[0], plan.approach[0] + np.radians([0, -8.0, 0, 0, 0, 0])

    def _out(self, line: bytes) -> list[bytes]:
        self.said.append(line)
        return self.change(line)


@pytest.fixture
def desk(cell: Cell, plan: Plan) -> Desk:
    desk = Desk(cell, plan)
    desk.line.connect()
    return desk


def test_a_repeated_status_of_an_earlier_command_is_believed_by_nobody(desk: Desk) -> None:
    """The defect: a replayed status said that the robot was elsewhere, and the next motion led into the jig."""
    desk.line.state()
    old = [line for line in desk.said if line.startswith(b"! ST")][-1]
    desk.line.move(desk.far, RATE)
    desk.change = lambda line: [old, line] if line.startswith(b"! ST") else [line]

    state = desk.line.state()

    np.testing.assert_allclose(state.q, desk.far, atol=1e-8)


def test_a_status_whose_answer_never_came_is_not_taken_from_an_older_one(desk: Desk) -> None:
    desk.line.state()
    old = [line for line in desk.said if line.startswith(b"! ST")][-1]
    desk.change = lambda line: [old] if line.startswith(b"! ST") else [line]

    with pytest.raises(LinkLost):
        desk.line.state()


def test_a_motion_delayed_past_a_restart_is_refused(desk: Desk) -> None:
    desk.line.move(desk.far, RATE)
    seen = list[bytes]()
    desk.server.spoil_in = lambda line: seen.append(line) or [line]  # type: ignore[func-returns-value]
    desk.line.move(desk.start, RATE)
    (frame,) = [line for line in seen if b"MOVE" in line]
    desk.server.reboot()
    moved, body = len(desk.world.motions), frame.decode().rpartition("*")[0].partition(" ")[2]

    desk.server.write(crc(f"1 {body}").encode())  # as the restarted controller counts

    assert desk.server.answer.startswith("1 ERR BOOT")
    assert len(desk.world.motions) == moved


def test_a_motion_delayed_past_a_stop_is_not_executed(desk: Desk) -> None:
    held = list[bytes]()

    def lose(line: bytes) -> list[bytes]:
        if b"MOVE" not in line:
            return [line]
        if held:
            raise KeyboardInterrupt
        held.append(line)
        return []

    desk.server.spoil_in = lose
    with pytest.raises(KeyboardInterrupt):
        desk.line.move(desk.far, RATE)
    desk.line.stop()

    desk.server.spoil_in = lambda line: [line]
    desk.server.write(held[0])
    desk.clock.sleep(10.0)

    assert desk.world.motions == []


class FirstVersion(LineServer):
    """A controller of the first version: plain heartbeats, and no boot on commands."""

    def _hear(self, raw: bytes) -> None:
        line = raw.decode("latin-1")
        if line.startswith("! ") and line not in ("! HB", "! STOP"):
            return self._say("? NAK")
        if "boot=" in line and "MOVE" in line:
            self.last += 1
            return self._answer(self.last, "ERR SYNTAX")
        return super()._hear(raw)

    def _say(self, body: str) -> None:
        super()._say(" ".join(word for word in body.split(" ") if not word.startswith("hb=")))


def test_a_controller_of_the_first_version_is_driven_and_said_to_be_one(cell: Cell, plan: Plan) -> None:
    desk = Desk(cell, plan, FirstVersion)
    desk.line.connect()

    np.testing.assert_allclose(desk.line.move(desk.far, RATE), desk.far, atol=1e-8)
    assert not desk.line.link.bound
    assert "first version" in desk.line.name


@pytest.mark.parametrize(
    ("stray", "reason"),
    [
        (lambda q, t: q + np.radians([0, 0, 0.3 * t, 0, 0, 0]), "off the commanded path"),
        (lambda q, t: q + 0.5 * t * np.radians([0, -8.0, 0, 0, 0, 0]), "expected at most"),
    ],
)
def test_a_robot_that_strays_is_stopped_and_the_reason_said(
    desk: Desk, stray: Callable[[np.ndarray, float], np.ndarray], reason: str
) -> None:
    original, began = desk.server._q, desk.clock.t
    desk.server._q = lambda: stray(original(), desk.clock.t - began)  # type: ignore[method-assign]

    with pytest.raises(Refused, match=reason) as refusal:
        desk.line.move(desk.far, RATE)

    assert refusal.value.code == "ASTRAY"
    assert desk.clock.t - began < 1.0
    assert desk.server.running is None


class Endless:
    """A port at which something speaks that is no controller."""

    url = "test://endless"

    def __init__(self, clock: Ticks, speech: Iterator[bytes]) -> None:
        self.clock, self.speech, self.sent = clock, speech, list[bytes]()

    def write(self, data: bytes) -> None:
        self.sent.append(data)

    def read(self, timeout: float) -> bytes:
        data = next(self.speech)
        self.clock.sleep(0.001 if data else max(timeout, 0.001))
        return data

    def reopen(self) -> None: ...

    def close(self) -> None: ...


def repeated(data: bytes) -> Iterator[bytes]:
    while True:
        yield data


SPEECHES = {
    "nothing": b"",
    "flood": b"x" * 4096,
    "flood of lines": b"abc\n" * 1000,
    "trickle": b"x",
    "half lines": b"0 OK TOU",
    "valid lines": crc("! ST boot=A1B2 RUN seq=1 hb=1 probe=0 q=1,2,3,4,5,6").encode() * 20,
    "refusals": crc("? NAK").encode(),
}


@pytest.mark.parametrize("speech", SPEECHES)
def test_no_call_outlasts_its_bound_whatever_the_port_says(cell: Cell, speech: str) -> None:
    """The defect: a port that floods kept the driver for ever, without a heartbeat."""
    clock = Ticks()
    line = Line(Endless(clock, repeated(SPEECHES[speech])), cell.robot, clock)

    for call in (line.connect, line.state, line.stop, line.latch, lambda: line.move(np.zeros(6), RATE)):
        began = clock.t
        with pytest.raises((LinkLost, Refused)):
            call()
        assert clock.t - began < 10.0
    assert len(line.link._lines._rest) <= 200


@pytest.mark.parametrize("speech", SPEECHES)
def test_a_port_that_turns_mad_in_a_motion_is_given_up_in_ten_seconds_and_told_to_stop(desk: Desk, speech: str) -> None:
    began, read, mad = desk.clock.t, desk.server.read, Endless(desk.clock, repeated(SPEECHES[speech]))

    def turned(timeout: float) -> bytes:
        return read(timeout) if desk.clock.t < began + 0.5 else mad.read(timeout)

    desk.server.read = turned  # type: ignore[method-assign]

    with pytest.raises((LinkLost, Refused)):
        desk.line.search(desk.far, RATE / 10)

    assert desk.clock.t - began < 10.0
