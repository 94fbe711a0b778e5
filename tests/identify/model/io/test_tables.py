"""Touches, positions and plans from CSV and back: what is written is read again, and what is wrong has its line."""

import csv
import io
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sheets import POSITIONS, TOUCHES, change, mistakes

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.description import library, read_jig, read_robot
from identify.model.io.tables import plan_text, positions_text, read_plan, read_positions, read_touches, touches_text
from identify.model.touch import HIT, Plan, Positions, Touches

text = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]) | st.just(" "), max_size=12).map(str.strip)


def test_touches_that_happened_are_read_with_their_planes(write, arc_welder):
    touches = read_touches(write(TOUCHES), arc_welder)

    assert touches.ids == ("t1", "t3", "t4")
    assert touches.face == ("top-low", "", "right-low")
    np.testing.assert_allclose(np.degrees(touches.q[0]), [10, -20, 30.5, 40, 50, 60])
    np.testing.assert_allclose(touches.normal, [[0, 0, 1], [0, 0.6, -0.8], [1, 0, 0]])
    np.testing.assert_allclose(touches.offset, [100, 120.5, 350])
    np.testing.assert_allclose(touches.sigma, [0.05, 0.1, 0.03])  # the cell's 0.05 if the row says nothing
    np.testing.assert_array_equal(touches.temperature, [21.5, np.nan, np.nan])
    assert touches.note == ("first", "", "a note, with a comma")


def test_only_names_joints_and_face_are_required(write, arc_welder):
    text = "face,q6_deg,q5_deg,q4_deg,q3_deg,q2_deg,q1_deg,id\ntop-low,6,5,4,3,2,100,a\n"

    touches = read_touches(write(text), arc_welder)

    np.testing.assert_allclose(np.degrees(touches.q), [[100, 2, 3, 4, 5, 6]])
    assert touches.status == (HIT,)


def test_positions_are_read_with_the_scatter_of_the_cell(write, arc_welder):
    positions = read_positions(write(POSITIONS), arc_welder)

    np.testing.assert_allclose(positions.point[1], [150, 200, 300])
    np.testing.assert_allclose(positions.sigma, arc_welder.touch.sigma)


def test_a_prismatic_joint_is_read_in_millimetres(write, arc_welder):
    scara = read_robot(library("robots")["scara"])
    cell = Cell(scara, arc_welder.jig, np.zeros(6), np.zeros(6))

    touches = read_touches(write("id,face,q1_deg,q2_deg,q3_mm,q4_deg\na,top-low,90,180,120,45\n"), cell)

    np.testing.assert_allclose(touches.q, [[np.pi / 2, np.pi, 120, np.pi / 4]])


MISTAKES = {
    "NaN": ("10,-20,30.5", "10,nan,30.5", "2: q2_deg is 'nan', expected a number; measure it again"),
    "infinite": ("10,-20,30.5", "10,1e999,30.5", "2: q2_deg is '1e999', expected a number"),
    "empty": ("10,-20,30.5", "10,,30.5", "2: q2_deg is 'empty', expected a number"),
    "a word": ("10,-20,30.5", "10,ten,30.5", "2: q2_deg is 'ten', expected a number"),
    "decimal comma in quotes": ("10,-20,30.5", '10,-20,"30,5"', "2: q3_deg is '30,5', expected a number; write it"),
    "decimal comma": ("10,-20,30.5", "10,-20,30,5", "2: 18 cells where the header has 17; is a decimal comma in it?"),
    "a line cut short": ("12,-22,32,42,52,62,,", "12,-22", "5: 12 cells where the header has 17; the line is cut"),
    "unknown face": ("right-low", "right-lo", "5: jig 'step-block' has no face 'right-lo'; did you mean 'right-low'?"),
    "duplicate id": ("t4,", "t1,", "5: id 't1' stands already in line 2; give every row a name of its own"),
    "no id": ("t4,", ",", "5: id is empty"),
    "status": ("07,miss", "07,missed", "3: status is 'missed', expected one of hit, miss, early, skipped, outlier"),
    "no plane": ("right-low", "", "5: neither a face nor a whole plane (nx, ny, nz, offset_mm)"),
    "half a plane": ("0,0.6,-0.8,120.5", "0,0.6,,120.5", "4: neither a face nor a whole plane"),
    "normal too long": ("0,0.6,-0.8", "0,6,-8", "4: the normal has length 10, expected 1; divide nx, ny, nz by 10"),
    "face and another plane": ("right-low,,,,", "right-low,1,0,0,340", "5: the plane in numbers is not that of face"),
    "sigma zero": ("120.5,0.1", "120.5,0", "4: sigma_mm is 0, expected a length above 0"),
    "column missing": (
        "q2_deg,",
        "q2,",
        "1: column 'q2_deg' is missing; if 'q2' is meant, write it under this name, in this unit",
    ),
    "column twice": ("q3_deg,q4_deg", "q3_deg,q3_deg,q4_deg", "1: column 'q3_deg' stands twice in the header"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_in_touches_has_its_line_and_one_sentence(write, arc_welder, case):
    old, new, sentence = MISTAKES[case]

    found = mistakes(write(change(TOUCHES, old, new)), arc_welder)

    assert found[0].startswith(sentence)
    assert len(found) == (5 if case == "column twice" else 1)  # there every row is short of a cell


def test_mistakes_of_every_kind_come_at_once_in_the_order_of_lines(write, arc_welder):
    text = change(TOUCHES, "q6_deg", "q6")
    text = change(text, "10,-20", "x,-20")
    text = change(text, "t3,", "t1,")
    text = change(text, "0.1,11,-21,31", "-0.1,11,-21")
    text = change(text, "right-low", "leftmost").rstrip("\n")

    found = mistakes(write(text), arc_welder)

    assert [line.split(":")[0] for line in found] == ["1", "2", "4", "5", "5"]
    assert "torn" in found[4] or "torn" in found[3]


@pytest.mark.parametrize("cut", [1, 2, 10, 40, 60])
def test_a_torn_last_line_is_refused_wherever_it_tore(write, arc_welder, cut):
    found = mistakes(write(TOUCHES[:-cut]), arc_welder)

    assert len(found) == 1  # and not a second sentence about the cells it lacks
    assert found[0].startswith("5: the last line does not end, it may be torn; complete it")


def radians(text):
    rows = list(csv.reader(io.StringIO(text)))
    joints = [i for i, name in enumerate(rows[0]) if name.startswith("q")]
    for row in rows[1:]:
        for i in joints:
            row[i] = str(np.radians(float(row[i]))) if row[i] else ""
    return "\n".join(",".join(f'"{cell}"' for cell in row) for row in rows) + "\n"


@pytest.mark.parametrize(("text", "read"), [(TOUCHES, read_touches), (POSITIONS, read_positions)])
def test_joint_angles_in_radians_are_refused_unless_trusted(write, arc_welder, text, read):
    path = write(radians(text))

    found = mistakes(path, arc_welder, read)

    assert len(found) == 1
    assert found[0].startswith("0: no joint angle is larger than 1.08: radians? write degrees, or say --trust-units")
    assert read(path, arc_welder, trust_units=True).q.shape == (3, 6)


def test_positions_in_metres_are_refused_unless_trusted(write, arc_welder):
    text = POSITIONS.replace("100,200,300", "0.1,0.2,0.3").replace("150,200,300", "0.15,0.2,0.3")
    path = write(text.replace("100,280,300", "0.1,0.28,0.3"))

    assert mistakes(path, arc_welder, read_positions) == [
        "0: all positions lie within 0.08 mm: metres? write millimetres, or say --trust-units"
    ]
    assert read_positions(path, arc_welder, trust_units=True).point.max() == 0.3


def test_planes_in_metres_are_refused_unless_trusted(write, arc_welder):
    rows = "".join(f"t{i},0,0,1,0.1{i},{20 + i},2,3,4,5,6\n" for i in range(3))
    path = write("id,nx,ny,nz,offset_mm,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n" + rows)

    found = mistakes(path, arc_welder)

    assert len(found) == 1
    assert found[0].startswith("0: no plane lies further than 5 mm from the jig's origin: metres?")
    assert len(read_touches(path, arc_welder, trust_units=True)) == 3


@pytest.mark.parametrize("read", [read_touches, read_positions])
def test_a_header_without_rows_is_an_empty_table(write, arc_welder, read):
    text = TOUCHES if read is read_touches else POSITIONS

    table = read(write(text.split("\n")[0] + "\n"), arc_welder)

    assert len(table) == 0
    assert table.q.shape == (0, 6)


def test_a_cell_without_a_jig_reads_planes_and_says_what_faces_need(write, arc_welder):
    cell = Cell(arc_welder.robot, None, np.zeros(6), np.zeros(6))

    found = mistakes(write(TOUCHES), cell)

    assert [line.split(" needs")[0] for line in found] == ["2: face 'top-low'", "5: face 'right-low'"]
    planes = "".join(line for line in TOUCHES.splitlines(keepends=True) if line[:2] in {"id", "t3"})
    assert len(read_touches(write(planes), cell)) == 1


ROBOTS = {name: read_robot(path) for name, path in library("robots").items()}


JIG = read_jig(library("jigs")["step-block"])


names = st.lists(text.filter(bool), min_size=1, max_size=6, unique=True)


sizes = st.floats(1e-4, 1e3)


everywhere = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])


def matrix(rows, columns, low, high):
    return arrays(float, (rows, columns), elements=st.floats(low, high))


@st.composite
def cells(draw):
    return Cell(ROBOTS[draw(st.sampled_from(sorted(ROBOTS)))], JIG, np.zeros(6), np.zeros(6))


@st.composite
def touch_tables(draw):
    cell = draw(cells())
    ids = draw(names)
    n = len(ids)
    face = draw(st.lists(st.sampled_from(["", *JIG.by_name]), min_size=n, max_size=n))
    normal = draw(matrix(n, 3, -1, 1)) + np.array([0, 0, 3])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    offset, sigma = draw(arrays(float, n, elements=st.floats(-2e3, 2e3))), draw(arrays(float, n, elements=sizes))
    for i, known in enumerate(JIG.by_name.get(name) for name in face):
        if known:
            normal[i], offset[i] = known.normal, known.offset
    temperature = draw(arrays(float, n, elements=st.floats(-50, 90) | st.just(np.nan)))
    texts = [tuple(draw(st.lists(text, min_size=n, max_size=n))) for _ in range(2)]
    q = draw(matrix(n, len(cell.robot.joints), -7, 7)) * cell.robot.upper
    return cell, Touches(tuple(ids), tuple(face), q, normal, offset, sigma, (HIT,) * n, temperature, *texts)


@everywhere
@given(touch_tables())
def test_touches_that_are_written_are_read_again(write, table):
    cell, touches = table

    again = read_touches(write(touches_text(touches, cell.robot)), cell, trust_units=True)

    assert (again.ids, again.face, again.time, again.note) == (touches.ids, touches.face, touches.time, touches.note)
    np.testing.assert_allclose(again.q, touches.q, rtol=0, atol=1e-9)  # written to 1e-9 degrees or mm
    np.testing.assert_allclose(again.normal, touches.normal, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(again.offset, touches.offset)
    np.testing.assert_allclose(again.sigma, touches.sigma, rtol=1e-9)
    np.testing.assert_array_equal(again.temperature, touches.temperature)


def test_a_plane_is_written_as_numbers_only_where_no_face_names_it(write, arc_welder):
    touches = read_touches(write(TOUCHES), arc_welder)

    rows = list(csv.DictReader(io.StringIO(touches_text(touches, arc_welder.robot))))

    assert [[row[key] for key in ("face", "nz", "offset_mm", "sigma_mm")] for row in rows] == [
        ["top-low", "", "", "0.05"],
        ["", "-0.8", "120.5", "0.1"],
        ["right-low", "", "", "0.03"],
    ]


@everywhere
@given(cells(), names, st.data())
def test_positions_that_are_written_are_read_again(write, cell, ids, data):
    n = len(ids)
    q = data.draw(matrix(n, len(cell.robot.joints), -7, 7)) * cell.robot.upper
    point = data.draw(matrix(n, 3, -3e3, 3e3))
    positions = Positions(tuple(ids), q, point, data.draw(arrays(float, n, elements=sizes)))

    path = write(positions_text(positions, cell.robot))
    again = read_positions(path, cell, trust_units=True)

    assert again.ids == positions.ids
    np.testing.assert_allclose(again.q, q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(again.point, point, rtol=0, atol=5.1e-7)  # written to a nanometre
    np.testing.assert_array_equal(again.sigma, positions.sigma)


@everywhere
@given(cells(), names, st.data())
def test_plans_that_are_written_are_read_again(write, cell, ids, data):
    n, joints = len(ids), len(cell.robot.joints)
    face = tuple(data.draw(st.lists(st.sampled_from(sorted(JIG.by_name)), min_size=n, max_size=n)))
    normal = np.array([JIG.by_name[name].normal for name in face])
    q, approach = (data.draw(matrix(n, joints, -7, 7)) * cell.robot.upper for _ in range(2))
    plan = Plan(tuple(ids), face, data.draw(matrix(n, 3, -3e3, 3e3)), normal, q, approach)

    written = plan_text(plan, cell.robot)
    again = read_plan(write(written), cell)

    assert (again.ids, again.face) == (plan.ids, plan.face)
    np.testing.assert_allclose(again.q, q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(again.approach, approach, rtol=0, atol=1e-9)
    np.testing.assert_allclose(again.point, plan.point, rtol=0, atol=5.1e-7)
    np.testing.assert_allclose(again.normal, normal, atol=1e-12)
    assert plan_text(again, cell.robot) == written  # once written, a plan stays the same to the byte


def test_a_mistake_in_a_plan_has_its_line(write, arc_welder):
    q = np.radians([[10.0, 20, 30, 40, 50, 60]])
    plan = Plan(("t1",), ("top-low",), np.array([[60.0, 160, 100]]), np.array([[0.0, 0, 1]]), q, q)
    written = plan_text(plan, arc_welder.robot)

    assert mistakes(write(change(written, "top-low", "top")), arc_welder, read_plan)[0].startswith(
        "2: jig 'step-block' has no face 'top'; did you mean"
    )
    assert mistakes(write(change(written, "approach_q6_deg", "q7_deg")), arc_welder, read_plan) == [
        "1: column 'approach_q6_deg' is missing"
    ]


def test_postures_on_the_way_are_written_and_read_where_there_are_any(write, arc_welder):
    q = np.radians([[10.0, 20, 30, 40, 50, 60]] * 2)
    via = np.full((2, 2, 6), np.nan)
    via[1] = [q[0] + 0.1, q[0] + 0.2]
    point, normal = np.array([[60.0, 160, 100]] * 2), np.array([[0.0, 0, 1]] * 2)
    plan = Plan(("t1", "t2"), ("top-low",) * 2, point, normal, q, q, via)

    written = plan_text(plan, arc_welder.robot)
    again = read_plan(write(written), arc_welder)

    np.testing.assert_allclose(again.via, via, atol=1e-10)
    np.testing.assert_allclose(again.way(0), q[:1])
    np.testing.assert_allclose(again.way(1), np.vstack([via[1], q[:1]]))
    assert "via" not in plan_text(Plan(plan.ids, plan.face, point, normal, q, q), arc_welder.robot)
    torn = "\n".join(line.rpartition(",")[0] + "," if line.startswith("t2") else line for line in written.splitlines())
    assert mistakes(write(torn + "\n"), arc_welder, read_plan) == [
        "3: via2_q1_deg to via2_q6_deg: some are empty; write all of them, or none"
    ]


def test_rows_are_taken_in_the_order_that_is_asked_for(write, arc_welder):
    touches = read_touches(write(TOUCHES), arc_welder)

    picked = touches.take(np.array([2, 0]))
    masked = touches.take(np.array([False, True, True]))

    assert picked.ids == ("t4", "t1")
    np.testing.assert_array_equal(picked.q, touches.q[[2, 0]])
    assert masked.note == touches.note[1:]
    np.testing.assert_array_equal(masked.offset, touches.offset[1:])


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_mutilated_tables_never_end_in_anything_but_a_sentence(write, arc_welder, data):
    wounded = data.draw(st.sampled_from([TOUCHES, POSITIONS]))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(wounded)))
        word = data.draw(st.sampled_from(["", ",", '"', "\n", "\r", "nan", "-", "x", "\x00", "é", ";", "1e400"]))
        wounded = wounded[:at] + word + wounded[at + data.draw(st.integers(0, 12)) :]
    path = write(wounded)

    for read in (read_touches, read_positions, read_plan):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "file.csv|.*unknown column", UserWarning)
            try:
                table = read(path, arc_welder)
            except InputError:
                continue
        assert np.isfinite(table.q).all()
        assert len(set(table.ids)) == len(table.ids)
