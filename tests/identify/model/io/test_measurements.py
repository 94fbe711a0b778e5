"""Files of any kind of measurement: each row is of the kind whose columns it fills, and mistakes have their line."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.cell import Point
from identify.model.files import InputError
from identify.model.io.measurements import read_measurements
from identify.model.measurement import rows
from identify.model.touch import Contacts, Distances, Poses, Positions, Touches

JOINTS = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg"
Q = "10,20,30,40,50,60"


@pytest.fixture
def cell(arc_welder):
    points = {"pin": Point(np.array([100.0, 0.0, 50.0])), "hole": Point(None)}
    return replace(arc_welder, points=points, placements={"second": None}, tools={"ball": np.zeros(6)})


@pytest.fixture
def read(cell, tmp_path):
    def of(text):
        path = tmp_path / "measured.csv"
        path.write_text(text)
        return read_measurements(path, cell)

    return of


def wrong(read, text):
    with pytest.raises(InputError) as error:
        read(text)
    return [(mistake.line, mistake.text) for mistake in error.value.mistakes]


def test_one_file_may_hold_every_kind(read):
    header = f"id,face,x_mm,y_mm,z_mm,rz_deg,ry_deg,rx_deg,anchor,distance_mm,point,placement,tool,{JOINTS}\n"
    tables = read(
        header
        + f"a,top-high,,,,,,,,,,,,{Q}\n"
        + f"b,,1,2,300,,,,,,,second,,{Q}\n"
        + f"c,,4,5,600,90,0,-90,,,,,ball,{Q}\n"
        + f"d,,,,,,,,pin,400,,,,{Q}\n"
        + f"e,,,,,,,,,,hole,second,,{Q}\n"
        + f"f,,,,,,,,pin,399,,,,{Q}\n"
    )

    touch, position, pose, distance, contact = tables
    assert [type(t) for t in tables] == [Touches, Positions, Poses, Distances, Contacts]
    assert (touch.face, position.placement, pose.tool) == (("top-high",), ("second",), ("ball",))
    np.testing.assert_allclose(pose.angles, [[np.pi / 2, 0, -np.pi / 2]])
    assert (distance.ids, distance.anchor) == (("d", "f"), ("pin", "pin"))
    np.testing.assert_allclose(distance.distance, [400, 399])
    assert (contact.point, contact.placement) == (("hole",), ("second",))


def test_rows_of_two_kinds_at_once_are_refused(read):
    found = wrong(read, f"id,anchor,distance_mm,point,{JOINTS}\na,pin,400,hole,{Q}\n")

    assert found == [(2, "the columns of a distance and of a contact are filled; keep one measurement a row")]


def test_names_that_the_cell_does_not_have_are_refused_with_the_nearest(read):
    found = wrong(read, f"id,point,placement,{JOINTS}\na,hole,secnd,{Q}\nb,holes,,{Q}\n")

    assert found == [
        (
            2,
            "placement 'secnd' is not in the cell; did you mean 'second'?; add it to placements: as fit, or with "
            "its pose",
        ),
        (3, "point 'holes' is no point of the cell; did you mean 'hole'?; add it to points:"),
    ]


def test_a_kind_whose_columns_are_not_whole_is_refused(read):
    found = wrong(read, f"id,anchor,{JOINTS}\na,pin,{Q}\n")

    assert (1, "column 'distance_mm' of a distance is missing") in found


@pytest.mark.parametrize(("distance", "words"), [("-3", "above 0"), ("nan", "expected a number"), ("", "expected")])
def test_a_distance_that_is_none_is_refused(read, distance, words):
    found = wrong(read, f"id,anchor,distance_mm,{JOINTS}\na,pin,{distance},{Q}\n")

    assert found[0][0] == 2
    assert words in found[0][1]


def test_a_plan_is_not_taken_for_measurements(read):
    approach = ",".join(f"approach_{name}" for name in JOINTS.split(","))

    with pytest.raises(InputError, match=r"this is a plan, not touches; make them: touchcal run .*measured.csv"):
        read(f"id,face,x_mm,y_mm,z_mm,{JOINTS},{approach}\n1,top-high,1,2,300,{Q},{Q}\n")


def test_a_column_without_its_unit_is_not_passed_over(read):
    assert wrong(read, f"id,face,sigma,{JOINTS}\na,top-high,0.2,{Q}\n") == [
        (1, "column 'sigma' has no unit; write it as 'sigma_deg' or 'sigma_mm'")
    ]


def test_rows_of_every_kind_may_say_how_warm_the_robot_was(read, cell):
    header = f"id,face,x_mm,y_mm,z_mm,rz_deg,ry_deg,rx_deg,anchor,distance_mm,point,temperature_c,{JOINTS}\n"
    tables = read(
        header
        + f"a,top-high,,,,,,,,,,31,{Q}\n"
        + f"b,,1,2,300,,,,,,,32,{Q}\n"
        + f"c,,4,5,600,90,0,-90,,,,33,{Q}\n"
        + f"d,,,,,,,,pin,400,,34,{Q}\n"
        + f"e,,,,,,,,,,pin,,{Q}\n"
    )

    made = rows(cell.wire, tables, cell.robot, cell.places)

    warmth = [made.conditions[made.owner == k, -2] for k in range(5)]
    assert [len(part) for part in warmth] == [1, 3, 6, 1, 3]
    assert [set(part.tolist()) for part in warmth] == [{11.0}, {12.0}, {13.0}, {14.0}, {0.0}]


def test_rows_of_every_kind_may_say_what_the_flange_carried(read, cell, tmp_path):
    robot = replace(cell.robot, payload=(4.0, (0.0, 0.0, 50.0)))
    (tmp_path / "measured.csv").write_text(
        f"id,face,x_mm,y_mm,z_mm,anchor,distance_mm,point,payload_kg,status,{JOINTS}\n"
        + f"a,top-high,,,,,,,5,hit,{Q}\n"
        + f"missed,top-high,,,,,,,1,miss,{Q}\n"
        + f"b,,1,2,300,,,,0,,{Q}\nc,,,,,pin,400,,8,,{Q}\nd,,,,,,,pin,,,{Q}\n"
    )

    tables = read_measurements(tmp_path / "measured.csv", replace(cell, robot=robot))
    made = rows(cell.wire, tables, robot, cell.places)

    beyond = {name: set(made.conditions[made.owner == k, -1].tolist()) for k, name in enumerate(made.ids)}
    assert beyond == {"a": {0.25}, "b": {-1.0}, "c": {1.0}, "d": {0.0}}


def test_payloads_that_differ_need_to_know_where_they_hang(read, cell):
    header = f"id,face,payload_kg,{JOINTS}\n"

    assert len(read(header + f"a,top-high,5,{Q}\nb,top-high,,{Q}\nc,top-high,5,{Q}\n")[0]) == 3
    ((line, text),) = wrong(read, header + f"a,top-high,5,{Q}\nb,top-high,7.5,{Q}\n")
    assert line == 3
    assert "payload_kg is 7.5, other than 5" in text
    assert "payload: {mass_kg: 5, centre_mm: [x, y, z]} into cell.yaml" in text


def test_a_payload_is_a_mass(read):
    found = wrong(read, f"id,face,payload_kg,{JOINTS}\na,top-high,-1,{Q}\nb,top-high,two,{Q}\n")

    assert [line for line, _ in found] == [2, 3]
    assert found[0][1] == "payload_kg is -1, expected the mass at the flange, 0 or more"
