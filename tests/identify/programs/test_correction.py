"""What all makers' programs share: numbers in their own style, orientations, frames, and files that fail as a whole."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from identified import identified
from programs import CELL, TRUTH
from scipy.spatial.transform import Rotation

from identify.model.files import InputError
from identify.model.robot import Robot
from identify.programs.fixing import fix
from identify.programs.makers import MAKERS, maker_of
from identify.programs.numbers import NUMBER, decimals, number, written
from identify.programs.orientation import angle_between, euler_near, from_euler, from_quaternion, quaternion_near
from identify.programs.setup import counting, read_setup
from identify.programs.source import Scanner, Source, blanked, source_of

ROBOT: Robot = CELL.robot
DEGREES = st.floats(-180, 180)
SETUP = """
frames: {1: {x_mm: 800, rz_deg: 90}, wobj1: {z_mm: 400}}
tools: {3: {z_mm: 410}}
joints: {sign: [1, 1, -1, 1, 1, 1], zero_deg: [0, 90, 0, 0, 0, 0], coupled: true, pulses_per_deg: [1, 2, 3, 4, 5, 6]}
near_deg: [0, 0, 0, 0, -90, 0]
fixed_to: robot
"""


def rewritten(text, value, least=3, *, padded=False, bare=False):
    """A line with its last number replaced."""
    match = list(re.finditer(NUMBER, text))[-1]
    old = number(match, padded=padded)
    return text[: old.start - old.lead] + written(old, value, least, bare=bare) + text[old.end :]


@pytest.mark.parametrize(
    ("text", "value", "expected"),
    [
        ("X 12.345,", -0.5, "X -0.500,"),
        ("X 12,", 3.14159, "X 3.142,"),
        ("X 12.,", 3.14159, "X 3.142,"),
        ("X 1.23456789,", 2.0, "X 2.00000000,"),
        ("X 1.5E-05,", 0.25, "X 0.250000,"),
        ("X .5,", 0.25, "X .250,"),
        ("X .5,", 1.25, "X 1.250,"),
        ("X +1.5,", 2.5, "X +2.500,"),
        ("X -0.001,", 0.0001, "X 0.000,"),
        ("X -0.001,", -0.0001, "X 0.000,"),
        ("X 0012.50,", -3.0, "X -0003.000,"),
        ("X   12.345,", 1234.5, "X 1234.500,"),
        ("X   12.345,", 12345.5, "X 12345.500,"),
        ("X   12.345,", 1.5, "X    1.500,"),
    ],
)
def test_a_number_is_written_in_the_style_of_the_one_it_replaces(text, value, expected):
    assert rewritten(text, value) == expected


def test_formats_that_line_numbers_up_keep_the_right_edge_where_there_is_room():
    assert rewritten("X = -12.345 mm", 1.5, padded=True) == "X =   1.500 mm"
    assert rewritten("X = 12.345 mm", -123.5, padded=True) == "X = -123.500 mm"


@pytest.mark.parametrize(
    ("text", "value", "expected"),
    [
        ("J1=     5.000 deg", -0.25, "J1=     -.250 deg"),
        ("J1=     0.000 deg", 0.25, "J1=      .250 deg"),
        ("J1=     0.250 deg", 0.5, "J1=     0.500 deg"),
        ("J1=     -.250 deg", 0.0, "J1=      .000 deg"),
    ],
)
def test_formats_without_the_zero_before_the_point_leave_it_out(text, value, expected):
    assert rewritten(text, value, padded=True, bare=True) == expected


@pytest.mark.parametrize(("text", "count"), [("1", 0), ("1.", 0), ("1.25", 2), (".5", 1), ("1.5e-3", 4), ("1.5e3", 0)])
def test_decimals_are_counted_with_their_exponent(text, count):
    assert decimals(text, 0) == count


@given(st.floats(-2000, 2000), st.integers(0, 9), st.floats(-2000, 2000), st.booleans(), st.booleans())
def test_what_is_written_reads_back_within_its_decimals(old, digits, new, padded, bare):
    text = rewritten(f"X =   {old:.{digits}f},", new, 3, padded=padded, bare=bare)

    last = re.findall(NUMBER, text)[-1]
    assert abs(float(last) - new) <= 0.500001 * 10.0 ** -max(3, digits)
    assert text.startswith("X = ")


@given(DEGREES, st.floats(-90, 90), DEGREES, st.floats(-8, 8), st.floats(-8, 8), st.floats(-8, 8))
def test_angles_nearest_to_old_ones_say_the_same_rotation(rz, ry, rx, a, b, c):
    old = np.array([rz, ry, rx])
    R = from_euler(old) @ from_euler(np.array([a, b, c]))

    angles = euler_near(R, old)

    assert np.abs(from_euler(angles) - R).max() < 1e-9
    assert (np.abs(angles) <= 180 + 1e-9).all()


def test_angles_beyond_a_right_angle_of_pitch_stay_there():
    old = np.array([10.0, 120.0, 20.0])

    angles = euler_near(from_euler(old + np.array([0, 1.0, 0])), old)

    assert np.abs(angles - [10, 121, 20]).max() < 1e-9


def test_an_angle_that_crosses_half_a_turn_comes_back_on_the_other_side():
    angles = euler_near(from_euler(np.array([180.5, 0, 0])), np.array([179.9, 0, 0]))

    assert np.abs(angles - [-179.5, 0, 0]).max() < 1e-9


@given(DEGREES, DEGREES, DEGREES)
def test_quaternions_agree_with_scipy_and_keep_the_sign_of_the_old_one(rz, ry, rx):
    truth = Rotation.from_euler("ZYX", [rz, ry, rx], degrees=True)
    old = -truth.as_quat(scalar_first=True) if rz > 0 else truth.as_quat(scalar_first=True)

    q = quaternion_near(from_euler(np.array([rz, ry, rx])), old)

    assert np.abs(q - old).max() < 1e-8
    assert np.abs(from_quaternion(1.003 * q) - truth.as_matrix()).max() < 1e-8


def test_the_angle_between_rotations_is_exact_next_to_nothing_and_half_a_turn():
    for angle in (0.0, 1e-7, 1.0, 179.99999, 180.0):
        assert angle_between(np.eye(3), from_euler(np.array([0, 0, angle]))) == pytest.approx(angle, abs=1e-10)


def test_comments_and_strings_are_blanked_without_moving_anything():
    text = 'a "x;y" b ; {c "d"\n;"e\nf'

    view = blanked(text, r";[^\n]*", r'"[^"\n]*"')

    assert view == 'a "___" b         \n   \nf'


def test_a_scanner_names_line_and_column_whatever_the_line_ends():
    for end in ("\n", "\r\n", "\r"):
        source = Source("p.ls", f"one{end}two three")
        scan = Scanner(source, source.text.index("three"))
        with pytest.raises(InputError, match=r"p.ls:2: column 5: found 'three', expected a number"):
            scan.need(NUMBER, "a number")


def test_bytes_survive_the_way_through_text():
    content = bytes(range(1, 256))

    assert source_of("p.ls", content).text.encode("latin-1") == content


@given(st.lists(st.floats(-170, 170), min_size=6, max_size=6), st.booleans())
def test_joints_of_a_maker_and_of_the_model_are_each_others_inverse(tmp_path_factory, angles, coupled):
    path = tmp_path_factory.mktemp("setup") / "setup.yaml"
    path.write_text(SETUP)
    robot = replace(ROBOT, counting=counting(ROBOT, read_setup(path, ROBOT), coupled))
    maker = np.array([angles])

    model = robot.from_controller(maker)

    assert np.abs(robot.to_controller(model) - maker).max() < 1e-9
    expected = np.radians([angles[0], angles[1] - 90, -(angles[2] + angles[1]), *angles[3:]])
    assert np.abs(model[0] - expected).max() < 1e-12


def test_a_setup_is_read_with_names_as_text(tmp_path):
    (tmp_path / "setup.yaml").write_text(SETUP)

    setup = read_setup(tmp_path / "setup.yaml", ROBOT)

    assert set(setup.frames) == {"1", "wobj1"}
    assert setup.tools["3"][2, 3] == 410
    assert setup.near[4] == pytest.approx(-np.pi / 2)
    assert (setup.fixed_to, setup.coupled, setup.joints.pulses[5]) == ("robot", True, 6)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("joints: {sign: [1, 1, 1]}", "setup.yaml:1: joints.sign has 3 numbers, the robot has 6 joints"),
        ("near_deg: [1, 2]", "setup.yaml:1: near_deg has 2 numbers, the robot has 6 joints"),
        ("joints: {sign: [2, 1, 1, 1, 1, 1]}", "joints.sign.0 is 2"),
        ("frame: {}", "unknown key 'frame'; did you mean 'frames'?"),
        ("frames: {1: {x: 3}}", "unknown key 'frames.1.x'"),
        ("posture: any", "posture is 'any'"),
    ],
)
def test_mistakes_of_a_setup_are_named(tmp_path, line, sentence):
    (tmp_path / "setup.yaml").write_text(line + "\n")

    with pytest.raises(InputError) as error:
        read_setup(tmp_path / "setup.yaml", ROBOT)

    assert sentence in str(error.value)


@pytest.mark.parametrize("suffix", MAKERS)
def test_every_maker_finds_nothing_to_correct_in_what_is_no_program(suffix):
    with pytest.raises(InputError, match=r"(?i)expected|is it cut short|not a"):
        fix(identified(CELL, TRUTH), {f"program{suffix}": b"nothing of this kind\n"})


@pytest.mark.parametrize("suffix", MAKERS)
def test_every_maker_describes_postures_and_decimals_for_what_it_writes(suffix):
    maker = MAKERS[suffix]

    assert "joints" in maker.decimals
    assert maker_of(f"SEAM{suffix.upper()}") is maker


def test_a_file_of_no_maker_is_refused_with_the_endings_that_are_known():
    with pytest.raises(
        InputError, match=r"seam.txt: not a program of a maker that is known; known endings: .ls.*touchcal compensate"
    ):
        maker_of("seam.txt")


def test_one_broken_program_among_several_refuses_all():
    good = b"/JOB\n//NAME A\n//POS\n///NPOS 0,0,0,0,0,0\n//INST\nNOP\nEND\n"

    with pytest.raises(InputError, match=r"b\.jbi"):
        fix(identified(CELL, TRUTH), {"a.jbi": good, "b.jbi": good[:-5]})
    assert fix(identified(CELL, TRUTH), {"a.jbi": good})[0].after == good
