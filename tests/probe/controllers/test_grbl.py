"""GRBL against a transcript, against a virtual one behind a real port, and against the traps that it is known for."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from touching import Ticks, clear_plan, pointed

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.touch import Plan
from probe.controllers import open_controller
from probe.controllers.grbl import Grbl
from probe.controllers.grbl_words import motion, read_probe, read_report, refusal
from probe.line.controller import Contact, Controller, NoContact, Rebooted, Refused
from probe.virtual.server import VirtualCell, serve
from probe.virtual.truth import Truth, draw_truth, with_effects

UNIT = 0.1  # deg an axis unit


@pytest.fixture(scope="module")
def cell(arc_welder: Cell) -> Cell:
    return pointed(arc_welder)


@pytest.fixture(scope="module")
def plan(cell: Cell) -> Plan:
    return clear_plan(cell, 4)


@pytest.fixture(scope="module")
def truth(cell: Cell) -> Truth:
    return with_effects(draw_truth(cell, np.random.default_rng(3), scale=0.15), sigma=0.0)


class Bench:
    """A virtual GRBL, and a search that meets a face after some seconds."""

    def __init__(self, served: VirtualCell, controller: Controller, plan: Plan) -> None:
        self.served, self.controller = served, controller
        self.start, self.end = plan.approach[0], plan.approach[0] + 2.0 * (plan.q[0] - plan.approach[0])
        self.rate = float(np.abs(self.end - self.start).max() / 5.0)

    def executed(self) -> list[str]:
        return [motion.kind for motion in self.served.robot.executed]


@contextmanager
def bench_of(cell: Cell, plan: Plan, truth: Truth, *faults: str, **options: object) -> Iterator[Bench]:
    with serve(
        cell, truth, protocol="grbl", speed=float("inf"), start=plan.approach[0], axis_unit_deg=UNIT, faults=faults
    ) as served:
        controller = open_controller(served.url, "grbl", cell.robot, axis_unit_deg=UNIT, **options)
        try:
            yield Bench(served, controller, plan)
        finally:
            controller.close()


@pytest.fixture
def bench(cell: Cell, plan: Plan, truth: Truth) -> Iterator[Bench]:
    with bench_of(cell, plan, truth) as bench:
        yield bench


class Scripted:
    """A GRBL made of answers: for each line, what comes back; MSG and ? are answered by themselves."""

    url = "test://grbl"

    def __init__(self, clock: Ticks, answers: dict[str, bytes], echo: bool = True) -> None:
        self.clock, self.answers, self.echo = clock, answers, echo
        self.sent: list[str] = []
        self.outbox = b""
        self.report = b"<Idle|MPos:10.000,20.000,30.000,40.000,50.000,60.000|FS:0,0>\r\n"

    def write(self, data: bytes) -> None:
        text = data.decode("latin-1")
        self.outbox += self.report * text.count("?")
        for line in filter(None, text.replace("?", "").split("\n")):
            self.sent.append(line)
            tag = re.search(r"\(MSG,(\w+)\)", line)
            if tag:
                self.outbox += f"[MSG:{tag[1]}]\r\nok\r\n".encode() if self.echo else b"ok\r\n"
                continue
            found = next((answer for start, answer in self.answers.items() if line.startswith(start)), b"ok\r\n")
            self.outbox += found

    def read(self, timeout: float) -> bytes:
        self.clock.sleep(max(timeout, 0.001))
        out, self.outbox = self.outbox, b""
        return out

    def reopen(self) -> None: ...
    def close(self) -> None: ...


AT = "10.000,20.000,30.000,40.000,50.000,61.500"
ANSWERS = {
    "$I": b"[VER:1.1f.20240101:]\r\n[OPT:VNM,35,1024]\r\n[AXS:6:XYZABC]\r\nok\r\n",
    "$G": b"[GC:G0 G54 G17 G21 G90 G94 M5 M9 T77 F0 S0]\r\nok\r\n",
    "$#": f"[G54:0.000,0.000,0.000,0.000,0.000,0.000]\r\n[PRB:{AT}:1]\r\nok\r\n".encode(),
    "G90 G93 G38.3": f"[PRB:{AT}:1]\r\nok\r\n".encode(),
}


def scripted(cell: Cell, answers: dict[str, bytes], echo: bool = True) -> tuple[Grbl, Scripted]:
    clock = Ticks()
    script = Scripted(clock, ANSWERS | answers, echo)
    return Grbl(script, cell.robot, clock), script


def test_reports_are_read_as_grbl_writes_them() -> None:
    report = read_report("<Hold:0|MPos:1.000,-2.500,3.000|FS:500,0|Pn:XPZ|WCO:0,0,0>", 3)

    assert report is not None
    assert (report.state, report.position.tolist(), report.probe) == ("Hold", [1.0, -2.5, 3.0], True)
    assert read_report("<Idle|WPos:1.000,2.000,3.000|FS:0,0>", 3) is None
    assert read_report("<Idle|MPos:1.000,2.000|FS:0,0>", 3) is None
    assert read_report("<Idle|MPos:1.000,2.0x0,3.000|FS:0,0>", 3) is None


def test_probes_and_refusals_are_read_as_grbl_writes_them() -> None:
    probe = read_probe("[PRB:1.000,2.000,-3.250:1]", 3)

    assert probe is not None
    assert (probe.position.tolist(), probe.success) == ([1.0, 2.0, -3.25], True)
    assert read_probe("[PRB:1.000,2.000:1]", 3) is None
    assert refusal("ALARM:4") == ("ALREADY", "ALARM:4")
    assert refusal("error:9") == ("UNHOMED", "error:9 locked by an alarm")
    assert refusal("ok") is None


def test_a_motion_says_how_long_it_lasts() -> None:
    assert motion("G38.3", np.array([1.0, -2.0]), 3.0) == "G90 G93 G38.3 X1.0000 Y-2.0000 F20.0000"


def test_a_search_is_a_guarded_motion_and_believed_when_it_is_printed_twice(cell: Cell) -> None:
    grbl, script = scripted(cell, {})
    grbl.connect()
    script.sent.clear()

    found = grbl.search(np.radians([10, 20, 30, 40, 50, 62.0]), np.radians(1.0))

    assert isinstance(found, Contact)
    np.testing.assert_allclose(np.degrees(found.q), [10, 20, 30, 40, 50, 61.5])
    assert found.boot == "T77"
    commands = [line for line in script.sent if not line.startswith("(")]
    assert commands == [
        "G90 G93 G38.3 X10.0000 Y20.0000 Z30.0000 A40.0000 B50.0000 C62.0000 F30.0000", "G4 P0.01", "$#",
    ]  # fmt: skip


def test_a_probe_that_is_not_printed_alike_twice_is_no_touch(cell: Cell) -> None:
    grbl, _ = scripted(cell, {"$#": b"[PRB:10.000,20.000,30.000,40.000,50.000,61.400:1]\r\nok\r\n"})
    grbl.connect()

    with pytest.raises(Refused, match="answer was lost"):
        grbl.search(np.radians([10, 20, 30, 40, 50, 62.0]), np.radians(1.0))


def test_answers_that_nobody_asked_for_do_not_shift_the_others(cell: Cell) -> None:
    grbl, script = scripted(cell, {"G90 G93 G38.3": b"[PRB:10.000,20.000,30.000,40.000,50.000,62.000:0]\r\nok\r\n",
                                   "$#": b"[PRB:10.000,20.000,30.000,40.000,50.000,62.000:0]\r\nok\r\n"})  # fmt: skip
    grbl.connect()
    script.outbox += b"error:7\r\nok\r\n[PRB:10.000,20.000,30.000,40.000,50.000,61.000:1]\r\nok\r\n"

    found = grbl.search(np.radians([10, 20, 30, 40, 50, 62.0]), np.radians(1.0))

    assert isinstance(found, NoContact)


def test_a_grbl_that_does_not_echo_messages_is_refused(cell: Cell) -> None:
    grbl, _ = scripted(cell, {}, echo=False)

    with pytest.raises(Exception, match="no GRBL that echoes messages"):
        grbl.connect()


@pytest.mark.parametrize(
    ("answers", "sentence"),
    [
        ({"$#": b"[G54:5.000,0.000,0.000,0.000,0.000,0.000]\r\nok\r\n"}, "G54 offsets its axes"),
        ({"$#": b"[G92:0.000,0.000,1.000,0.000,0.000,0.000]\r\nok\r\n"}, "G92 offsets its axes"),
        ({"$$": b"$10=1\r\n$13=1\r\nok\r\n"}, "reports inches"),
    ],
)
def test_a_grbl_whose_numbers_mean_something_else_is_refused(
    cell: Cell, answers: dict[str, bytes], sentence: str
) -> None:
    grbl, script = scripted(cell, answers)

    with pytest.raises(Refused, match=sentence):
        grbl.connect()

    assert not any(line.startswith("G") for line in script.sent)


def test_no_setting_is_ever_written_and_no_lock_opened_unasked(cell: Cell, plan: Plan, truth: Truth) -> None:
    with bench_of(cell, plan, truth) as bench:
        bench.controller.move(bench.start, bench.rate)
        bench.controller.search(bench.end, bench.rate)
        bench.controller.stop()
        heard = b"".join(bench.served.heard)

    assert not re.search(rb"\$(X|H|\d+=)", heard)
    assert bench.served.controller.settings_written == 0  # type: ignore[attr-defined]


def test_a_search_brings_back_where_the_wire_touched(bench: Bench) -> None:
    found = bench.controller.search(bench.end, bench.rate)

    assert isinstance(found, Contact)
    (truly,) = bench.served.robot.touches
    assert np.degrees(np.abs(found.q - truly.latch).max()) <= 0.5e-3 * UNIT + 1e-9
    assert np.abs(found.q - truly.q).max() <= bench.rate * 0.001 + np.radians(0.5e-3 * UNIT)
    assert found.boot == bench.controller.state().boot
    assert found.sequence == 1


def test_a_search_lasts_as_long_as_its_rate_says(bench: Bench) -> None:
    bench.served.robot.health.open = True

    found = bench.controller.search(bench.end, bench.rate)

    assert isinstance(found, NoContact)
    (made,) = bench.served.robot.executed
    assert made.ended - made.began == pytest.approx(5.0, rel=0.05)
    np.testing.assert_allclose(found.q, bench.end, atol=np.radians(1e-3 * UNIT))


def test_a_move_into_something_stops_and_the_way_back_is_open(bench: Bench) -> None:
    with pytest.raises(Refused) as refusal:
        bench.controller.move(bench.end, bench.rate)
    assert refusal.value.code == "EARLY"
    assert bench.controller.state().contact

    with pytest.raises(Refused) as refusal:
        bench.controller.search(bench.end, bench.rate)
    assert refusal.value.code == "ALREADY"
    bench.controller.move(bench.start, bench.rate)

    assert not bench.controller.state().contact
    np.testing.assert_allclose(bench.served.robot.q, bench.start, atol=np.radians(1e-3 * UNIT))


def test_a_machine_behind_an_alarm_is_not_moved_but_unlocked_on_request(cell: Cell, plan: Plan, truth: Truth) -> None:
    with bench_of(cell, plan, truth, "estop@1,seconds=0.5") as bench:
        with pytest.raises(Refused):
            bench.controller.search(bench.end, bench.rate)
        assert not bench.controller.state().homed
        with pytest.raises(Refused) as refusal:
            bench.controller.move(bench.start, bench.rate)
        assert refusal.value.code == "UNHOMED"
        bench.controller.close()
        bench.served.robot.health.estop = False
        with pytest.raises(InputError, match="locked by an alarm: home it, or unlock it"):
            open_controller(bench.served.url, "grbl", cell.robot, axis_unit_deg=UNIT)

        again = open_controller(bench.served.url, "grbl", cell.robot, axis_unit_deg=UNIT, unlock=True)

        assert again.state().homed
        again.close()


def test_a_restart_is_noticed_by_its_greeting(cell: Cell, plan: Plan, truth: Truth) -> None:
    with bench_of(cell, plan, truth, "reboot@1") as bench:
        before = bench.controller.state().boot
        with pytest.raises(Rebooted, match="not trusted"):
            bench.controller.search(bench.end, bench.rate)

        assert bench.controller.state().boot != before


def test_a_pulled_cable_ends_the_search_and_not_the_driver(cell: Cell, plan: Plan, truth: Truth) -> None:
    with bench_of(cell, plan, truth, "unplug@1,seconds=1") as bench:
        with pytest.raises(Refused) as refusal:
            bench.controller.search(bench.end, bench.rate)

        assert refusal.value.code == "NOTREACHED"
        assert bench.executed() == ["SEARCH"]
        bench.controller.move(bench.start, bench.rate)


def test_stopping_keeps_the_position(bench: Bench) -> None:
    bench.controller.move(bench.start, bench.rate)
    before = bench.controller.state()

    bench.controller.stop()

    after = bench.controller.state()
    np.testing.assert_array_equal(before.q, after.q)
    assert after.homed
    bench.controller.move(bench.start, bench.rate)


def test_a_latch_of_grbl_cannot_be_told_from_an_older_one(bench: Bench) -> None:
    bench.controller.search(bench.end, bench.rate)

    assert bench.controller.latch() is None
