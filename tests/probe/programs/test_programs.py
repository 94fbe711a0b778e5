"""What programs say and do beside touching: rehearsal, a closed input, misses in a row, parts, pages, options."""

from dataclasses import replace

import numpy as np
import pytest
from maker_bench import Bench, execute, make
from maker_machine import Machine

from identify.model.files import InputError
from identify.model.joint_counting import JointCounting
from probe.motion.joint_path import Geometry
from probe.motion.room import Room
from probe.motion.settings import Settings
from probe.programs.makers import MAKERS, PAGE, program
from probe.programs.options import UNTRIED, Options

FEW = 6


@pytest.fixture(scope="session")
def few(bench) -> Bench:
    """The first touches of the plan."""
    return replace(bench, plan=bench.plan.take(np.arange(FEW)))


@pytest.mark.parametrize("maker", MAKERS)
def test_a_rehearsal_visits_every_approach_from_further_off_and_never_searches(maker, few):
    files = program(few.plan, few.cell, maker, Options(rehearsal=True)).files
    robot = few.robot()
    robot.arm.collides = maker == "abb"

    logs = execute(maker, Machine(robot), files)

    assert robot.searches == 0
    assert robot.health.estop is False
    assert maker in ("fanuc", "yaskawa") or logs == {}
    tips = few.cell.kinematics.tip(np.array(robot.commanded), few.cell.theta)[0]
    nearest = [np.linalg.norm(tips - point, axis=1).min() for point in few.plan.point]
    assert min(nearest) > 30  # 25 mm of the approach, and less than 25 more at a joint limit
    assert np.abs(np.median(nearest) - 50) < 3


def test_an_approach_is_rehearsed_from_as_far_off_as_is_clear_and_the_page_says_so(few, monkeypatch):
    geometry, clear = Geometry(few.cell, Settings()), Room.clear

    def but_not_far_off_the_third(room, legs):
        third = few.plan.approach[2]
        blocked = [len(leg) == 2 and np.array_equal(leg[0], third) and geometry.length(*leg) > 15 for leg in legs]
        return [ok and not bad for ok, bad in zip(clear(room, legs), blocked, strict=True)]

    (before,) = program(few.plan, few.cell, "abb", Options(rehearsal=True)).notes
    monkeypatch.setattr(Room, "clear", but_not_far_off_the_third)
    made = program(few.plan, few.cell, "abb", Options(rehearsal=True))

    assert before.endswith("joint limit comes first: 5 (15 mm), 6 (10 mm)")
    assert made.notes[0].endswith("joint limit comes first: 3 (12 mm), 5 (15 mm), 6 (10 mm)")
    assert made.notes[0] in made.files[PAGE]


@pytest.mark.parametrize("maker", MAKERS)
def test_an_input_that_is_closed_before_a_search_stops_the_program_and_is_no_touch(maker, few, tmp_path):
    made = make(few, maker, tmp_path, Options(), stuck=True)

    assert len(made.machine.pauses) == 1
    assert made.touches.status == ("skipped", *("hit",) * (FEW - 1))
    assert "closed before the search" in made.touches.note[0]


@pytest.mark.parametrize("maker", MAKERS)
def test_three_misses_in_a_row_stop_the_program(maker, few, tmp_path):
    made = make(few, maker, tmp_path, Options(), missing={2, 3, 4})

    assert len(made.machine.pauses) == 1
    assert made.touches.status == ("hit", "miss", "miss", "miss", "hit", "hit")


@pytest.mark.parametrize("maker", MAKERS)
def test_touches_are_spread_over_files_and_logs_of_some_files_are_read_as_far_as_they_tell(maker, few, tmp_path):
    made = make(few, maker, tmp_path, Options(per_file=2, first=5), only="1")

    assert sum(name.startswith("TC3.") for name in made.files) >= 1
    assert made.touches.ids == few.plan.ids[:2]
    assert made.missing == few.plan.ids[2:]


@pytest.mark.parametrize("maker", MAKERS)
def test_joints_are_written_and_read_as_the_controller_counts_them(maker, few, tmp_path):
    counting = JointCounting(
        (1, -1, 1, 1, -1, 1), (0, 90.0, 0, 0, 0, -30.0), ((2, 1, 1),), few.cell.robot.counting.pulses
    )
    counted = replace(few, cell=replace(few.cell, robot=replace(few.cell.robot, counting=counting)))

    plain, other = (make(one, maker, tmp_path, Options()) for one in (few, counted))

    assert plain.files.keys() == other.files.keys()
    assert all(plain.files[name] != other.files[name] for name in plain.files if name.startswith("TC1."))
    np.testing.assert_allclose(other.touches.q, plain.touches.q, atol=np.radians(0.01))  # play that rounding turns
    assert other.touches.status == plain.touches.status


@pytest.mark.parametrize("maker", MAKERS)
def test_every_file_says_that_no_real_controller_has_run_it(maker, few):
    for rehearsal in (False, True):
        for name, text in program(few.plan, few.cell, maker, Options(rehearsal=rehearsal)).files.items():
            words = " ".join(text.translate(str.maketrans("!;:#'*0123456789", " " * 16)).split())
            assert UNTRIED in words or name.endswith(".dat"), name
            manual = bool(MAKERS[maker].instructions.unproven) and not rehearsal and not name.endswith(".dat")
            assert manual == ("the manual: no two public" in text.replace("\r\n'", " ")), name
            assert name == PAGE or text.isascii(), name


@pytest.mark.parametrize("maker", MAKERS)
def test_the_page_says_what_to_set_how_to_load_it_and_what_comes_back(maker, few):
    page = program(few.plan, few.cell, maker, Options()).files[PAGE]

    assert MAKERS[maker].example in page or maker == "ur"
    slowly = "speed slider at 10 %" if maker == "ur" else "T1 at 10 % override"
    assert ("T1" in page) == (maker != "ur")  # a Universal Robot has no mode of that name
    first = few.cell.robot.to_controller(few.plan.approach[0])
    assert f"Its joints are {', '.join(f'{value:.1f}' for value in first)}." in page
    for word in ("## Before", "## Load", slowly, "rehearsal", "touchcal import", "--maker " + maker):
        assert word in page


@pytest.mark.parametrize(
    ("maker", "options", "words"),
    [
        ("fanuc", Options(input="DI1"), "--input is 'DI1', expected one like DI[1]"),
        ("kuka", Options(input="DI[1]"), "expected one like $MEAS_PULSE[1]"),
        ("abb", Options(tool="1"), "--tool is '1', expected a name"),
        ("yaskawa", Options(input="RIN#(1)"), "expected one like RIN#(1),IN#(1)"),
        ("ur", Options(input="8"), "--input is '8'"),
        ("ur", Options(input="DI1"), "expected a number from 0 to 7 on Universal Robots"),
        ("ur", Options(wait=0.1), "--wait is 0.1, expected 0.3 to 10"),
        ("ur", Options(search_speed=-1.0), "search_speed is -1, expected more than 0"),
        ("fanuc", Options(registers=4), "no register is left for a touch"),
        ("fanucc", Options(), "did you mean 'fanuc'?"),
    ],
)
def test_an_option_that_a_controller_cannot_take_is_named_with_its_cure(few, maker, options, words):
    with pytest.raises(InputError) as error:
        program(few.plan, few.cell, maker, options)

    assert words in str(error.value)


@pytest.mark.parametrize(
    ("maker", "options", "touches"),
    [
        ("fanuc", Options(), 27),  # 200 numeric registers, ten of them for the routine, seven for each touch
        ("fanuc", Options(first=31), 22),
        ("fanuc", Options(registers=1000), 48),  # 100 position registers, three of them for the routine
        ("yaskawa", Options(), 64),  # 128 position variables
        ("yaskawa", Options(first=41), 44),
        ("yaskawa", Options(first=71), 20),  # 100 byte variables, ten of them for the job
    ],
)
def test_a_file_holds_as_many_touches_as_there_are_registers_behind_the_first(maker, options, touches):
    assert MAKERS[maker].capacity(options) == touches


def test_pulses_that_are_not_known_are_asked_for(few):
    robot = replace(few.cell.robot, counting=JointCounting())

    with pytest.raises(InputError, match="pulses_per_deg"):
        program(few.plan, replace(few.cell, robot=robot), "yaskawa", Options())


@pytest.mark.parametrize(
    ("kinds", "cure"),
    [
        ("RRRRR", "6 that turn: make the touches over a line, with touchcal run"),
        ("RRRRRRR", "6 that turn: make the touches over a line, with touchcal run"),
        ("PRRRRRR", "6 that turn: hold the track still and describe the arm behind it"),
    ],
)
def test_an_arm_that_is_not_six_turning_joints_is_refused_with_what_to_do(kinds, cure, few, arc_welder):
    joint = arc_welder.robot.joints[0]
    robot = replace(arc_welder.robot, joints=tuple(replace(joint, prismatic=kind == "P") for kind in kinds))

    with pytest.raises(InputError, match=rf"has {len(kinds)} joints \({kinds}\), and programs move {cure}"):
        program(few.plan, replace(few.cell, robot=robot), "abb", Options())
