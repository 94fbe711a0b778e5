"""The virtual GRBL: what a host of a six-axis GRBL has to live with."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from raw_host import RawHost
from virtual_support import make_plan, with_effects

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.virtual.batch import search_end
from probe.virtual.grbl import GrblController
from probe.virtual.robot import VirtualRobot
from probe.virtual.server import serve
from probe.virtual.truth import Truth

AXES = "XYZABC"


@pytest.fixture(scope="module")
def plan(arc_welder: Cell) -> Plan:
    return make_plan(arc_welder, 4)


class Desk:
    """A GRBL without a port, and the host's bytes and the time in the hand of the test."""

    def __init__(self, cell: Cell, plan: Plan, **options: float) -> None:
        truth = with_effects(Truth(cell.theta), sigma=0.0)
        self.robot = VirtualRobot(cell, truth, np.random.default_rng(3), start=plan.approach[0])
        self.grbl = GrblController(self.robot, **options)
        self.unit = float(np.radians(self.grbl.unit[0]))  # [rad] in one unit of an axis
        self.now = 0.0
        self.home, self.end = plan.approach[0], search_end(cell, plan)[0]

    def say(self, text: str) -> list[str]:
        """Bytes in, lines out."""
        return b"".join(self.grbl.feed(text.encode("latin-1"), self.now)).decode().split("\r\n")[:-1]

    def wait(self, seconds: float) -> list[str]:
        self.now += seconds
        return b"".join(self.grbl.advance(self.now)).decode().split("\r\n")[:-1]

    def words(self, q: np.ndarray) -> str:
        return "".join(f"{axis}{value:.3f}" for axis, value in zip(AXES, q / self.unit, strict=True))

    def numbers(self, text: str) -> np.ndarray:
        return self.unit * np.array([float(v) for v in text.split(":")[1].split("|")[0].split(",")])


@pytest.fixture
def desk(arc_welder: Cell, plan: Plan) -> Desk:
    return Desk(arc_welder, plan)


def test_a_tool_is_told_until_a_reset_forgets_it(desk):
    desk.say("T7\n")
    told = desk.say("$G\n")[0]
    desk.say("\x18")
    after = desk.say("$G\n")[0]

    assert " T7 " in told
    assert " T0 " in after
    assert desk.say("T256\n") == ["error:38"]


def test_a_grblhal_forgets_tool_and_offset_at_a_restart_only(desk):
    desk.grbl.quirks = frozenset({"soft-reset"})
    desk.say("T7\nG43.1X1\n")
    desk.say("\x18")
    reset = "".join(desk.say("$G\n") + desk.say("$#\n"))
    desk.grbl.restart()
    started = "".join(desk.say("$G\n") + desk.say("$#\n"))

    assert " T7 " in reset
    assert "[TLO:1.000," in reset
    assert " T0 " in started
    assert "[TLO:0.000," in started


@pytest.mark.parametrize("freed", ["\n", "$G\n", "\x18"])
def test_after_an_error_a_grblhal_takes_no_line_until_it_is_freed(desk, freed):
    desk.grbl.quirks = frozenset({"error-lock"})

    assert desk.say("G7\n") == ["error:20"]
    assert desk.say("T7\n") == ["error:20"]
    assert desk.say("(MSG,here)\n") == ["error:20"]
    desk.say(freed)
    assert desk.say("T7(MSG,here)\n") == ["[MSG:here]", "ok"]


def test_a_message_beside_an_error_and_in_alarm_is_not_echoed(desk):
    assert desk.say("G7(MSG,here)\n") == ["error:20"]
    desk.grbl.alarm = 4
    assert desk.say("(MSG,here)\n") == ["error:9"]


def test_build_information_tells_six_axes(desk):
    answer = desk.say("$I\n")

    assert "[AXS:6:XYZABC]" in answer
    assert answer[-1] == "ok"


def test_moves_are_answered_when_queued_and_a_dwell_when_they_are_done(desk):
    target = desk.home + 0.02

    queued = desk.say(f"G90 G94 G1 {desk.words(desk.home + 0.01)} F300\nG1{desk.words(target)}\nG4 P0\n")
    done = desk.wait(60)

    assert queued == ["ok", "ok"]
    assert done == ["ok"]
    assert desk.robot.q == pytest.approx(target, abs=np.radians(0.0006))
    assert len(desk.robot.executed) == 2


def test_feed_counts_the_length_over_all_axes(desk):
    step = np.radians([3.0, 0, 4.0, 0, 0, 0])

    desk.say(f"G1{desk.words(desk.home + step)}F60\n")
    desk.wait(60)

    (motion,) = desk.robot.executed
    assert motion.ended - motion.began == pytest.approx(5.0, rel=0.01)  # five units at one a second


def test_inverse_time_feed_is_minutes_for_the_whole_move(desk):
    desk.say(f"G93 G1 {desk.words(desk.home + 0.02)} F30\n")
    desk.wait(60)

    (motion,) = desk.robot.executed
    assert motion.ended - motion.began == pytest.approx(2.0, rel=0.03)


def test_a_motion_without_a_feed_is_an_error_and_changes_nothing(desk):
    """As the block checks of GRBL 1.1 have it: 22 for every motion but G0, and for each one of inverse time anew."""
    refused = desk.say(f"G91 G1 {desk.words(desk.home + 0.02)}\n")
    modes = desk.say("$G\n")[0]
    desk.say("G93 G91 F5\n")
    again = desk.say("G1 X1\n")

    assert (refused, again) == (["error:22"], ["error:22"])
    assert "[GC:G0 G54 G17 G21 G90 G94" in modes
    assert not desk.robot.moving


def test_a_restart_makes_an_inverse_time_a_feed_in_axis_units_a_minute(desk):
    """What makes a motion crawl whose modes GRBL has forgotten."""
    desk.say("G93 F30\n")
    desk.grbl.restart()

    desk.say(f"G1 {desk.words(desk.home + 0.2)} F30\n")
    desk.wait(1.0)

    assert np.degrees(np.linalg.norm(desk.robot.q - desk.home)) < 30 / 60 + 1e-6  # [deg], an axis unit each


def test_a_probe_reports_its_position_and_is_answered_at_its_end(desk, plan):
    asked = desk.say(f"G38.3{desk.words(desk.end)}F60\n")
    ended = desk.wait(120)
    reported = desk.say("$#\n")

    assert asked == []
    assert ended[0].startswith("[PRB:")
    assert ended[0].endswith(":1]")
    assert ended[1] == "ok"
    assert desk.numbers(ended[0]) == pytest.approx(desk.robot.touches[0].latch, abs=np.radians(0.00051))
    assert ended[0] in reported
    assert "Pn:P" in desk.say("?")[0]


def test_axis_units_of_a_tenth_of_a_degree_make_probes_ten_times_finer(arc_welder, plan):
    fine = Desk(arc_welder, plan, axis_unit_deg=0.1)

    fine.say(f"G38.3{fine.words(fine.end)}F600\n")
    ended = fine.wait(120)

    assert fine.numbers(ended[0]) == pytest.approx(fine.robot.touches[0].latch, abs=np.radians(0.000051))


def test_a_probe_that_begins_in_contact_is_alarm_4_and_then_ok(desk):
    desk.say(f"G38.3{desk.words(desk.end)}F60\n")
    desk.wait(120)

    again = desk.say(f"G38.3{desk.words(desk.end)}F60\n")
    locked, unlocked = desk.say("G0X0\n"), desk.say("$X\n")

    assert again == ["ALARM:4", "ok"]
    assert locked == ["error:9"]
    assert unlocked[-1] == "ok"


@pytest.mark.parametrize(("word", "alarm"), [("G38.2", ["ALARM:5"]), ("G38.3", [])])
def test_a_probe_without_contact_says_so_with_alarm_5_or_without(desk, word, alarm):
    away = desk.home - 0.3 * (desk.end - desk.home)

    desk.say(f"{word}{desk.words(away)}F600\n")
    ended = desk.wait(120)

    assert ended[: len(alarm)] == alarm
    assert ended[-2].endswith(":0]")
    assert ended[-1] == "ok"
    if not alarm:
        assert desk.numbers(ended[-2]) == pytest.approx(away, abs=np.radians(0.0006))


def test_a_target_beyond_a_limit_is_alarm_2_and_only_a_reset_helps(desk):
    refused = desk.say("G0X170\n")
    deaf = desk.say("$X\n")
    reset = desk.say("\x18")
    unlocked = desk.say("$X\n")

    assert refused[0] == "ALARM:2"
    assert deaf == []
    assert any("Grbl" in text for text in reset)
    assert unlocked[-1] == "ok"
    assert not desk.robot.executed


def test_feed_hold_brakes_and_a_cycle_start_goes_on(desk):
    target = desk.home + 0.05
    desk.say(f"G1{desk.words(target)}F60\n")
    desk.wait(1.0)

    desk.say("!")
    desk.wait(1.0)
    held, stood = desk.say("?")[0], desk.robot.q
    desk.wait(5.0)
    still = desk.robot.q
    desk.say("~")
    desk.wait(60)

    assert held.startswith("<Hold:0|")
    assert np.array_equal(stood, still)
    assert desk.robot.q == pytest.approx(target, abs=np.radians(0.0006))


def test_a_reset_while_moving_is_alarm_3_and_empties_the_queue(desk):
    desk.say(f"G1{desk.words(desk.home + 0.05)}F60\nG1{desk.words(desk.home)}F60\n")
    desk.wait(1.0)

    reset = desk.say("\x18")
    desk.wait(60)

    assert reset[0] == "ALARM:3"
    assert len(desk.robot.executed) == 1
    assert desk.say("G0X0\n") == ["error:9"]


def test_a_message_comes_back_as_the_mark_to_count_from(desk):
    assert desk.say("(MSG,tag 17)\n") == ["[MSG:tag 17]", "ok"]
    assert desk.say("G90 (MSG,x) (other)\n") == ["[MSG:x]", "ok"]


@pytest.mark.ghost
def test_the_probe_input_is_not_watched_during_a_move(desk):
    desk.say(f"G1{desk.words(desk.end)}F300\n")
    desk.wait(120)

    (motion,) = desk.robot.executed
    assert motion.outcome.kind == "OK"
    assert desk.robot.contact


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("G1X1\n", 22),
        ("G38.3F10\n", 26),
        ("G0G1X1\n", 21),
        ("X1X2\n", 25),
        ("G2X1\n", 20),
        ("G0Q1\n", 20),
        ("GX\n", 2),
        ("*\n", 1),
        ("$Z\n", 3),
        ("G1" + "X1" * 200 + "\n", 11),
    ],
)
def test_what_cannot_be_read_is_answered_by_its_error(desk, text, error):
    assert desk.say(text) == [f"error:{error}"]
    assert desk.robot.begun == 0


def test_a_setting_written_is_counted_against_the_host(desk):
    desk.say("$$\n$100=250\n")

    assert desk.grbl.settings_written == 1


def test_a_restart_prints_the_banner_and_forgets(desk):
    desk.say("G91\n")

    said = b"".join(desk.grbl.restart()).decode()

    assert "Grbl 1.1" in said
    assert "G90" in desk.say("$G\n")[0]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # one controller hears them all
@given(st.lists(st.text("GXYZF$0123456789.-!?~\x18\n ()M", max_size=30), max_size=6))
def test_any_text_leaves_the_controller_answering(desk, texts):
    for text in texts:
        desk.say(text)
    desk.wait(1000)
    desk.say("~\n\x18")
    desk.wait(10)

    assert desk.say("?")[-1].startswith("<")


def test_probes_are_made_over_a_real_port(arc_welder, plan):
    truth, desk = with_effects(Truth(arc_welder.theta), sigma=0.0), Desk(arc_welder, plan)
    with serve(arc_welder, truth, protocol="grbl", start=plan.approach[0], speed=float("inf")) as virtual:
        host = RawHost(virtual.url)
        for _ in range(3):
            host.send(f"G90G38.3{desk.words(desk.end)}F60\n".encode())
            probe, ok = host.read(), host.read()
            host.send(f"G1{desk.words(desk.home)}F600\nG4P0\n".encode())
            assert [ok, host.read(), host.read()] == ["ok"] * 3
            assert desk.numbers(probe) == pytest.approx(virtual.robot.touches[-1].latch, abs=np.radians(0.00051))
        host.close()

    assert len(virtual.robot.touches) == 3
