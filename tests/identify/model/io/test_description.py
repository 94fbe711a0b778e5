"""Cells, robots and jigs from YAML: what is wrong comes all at once, one sentence each, with file and line."""

import re

import numpy as np
import pytest
from cell_texts import CELL, JIG, ROBOT, change, mistakes
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from identify.model.files import InputError
from identify.model.io.description import read_cell, read_robot


def test_a_cell_is_understood_in_millimetres_and_radians(write_cell):
    cell = read_cell(write_cell())

    np.testing.assert_allclose(cell.base, [340, 740, 350, -np.pi / 2, 0, 0])
    np.testing.assert_allclose(cell.tool, [0, 0, 410, 0, -np.pi / 10, 0])
    assert cell.robot.prismatic == (False, False, True)
    np.testing.assert_allclose(cell.robot.lower, np.radians([-160, -110, 0]))
    np.testing.assert_allclose(cell.robot.upper, [*np.radians([160, 130]), 200])
    np.testing.assert_allclose(cell.robot.speed, [np.pi / 2, np.radians(100), 300])
    assert cell.fixed == {"j1.beta"}
    assert cell.bounds == {"j2.a": (340, 360)}
    assert cell.jig.by_name["top"].tolerance == 0.02
    assert cell.theta[cell.robot.parameters.index("j1.alpha")] == pytest.approx(-np.pi / 2)
    assert set(cell.sources) == {"cell.yaml", "robot.yaml", "jig.yaml"}


def test_angles_in_bounds_are_degrees(write_cell):
    cell = read_cell(write_cell(change(CELL, "j2.a: [340, 360]", "j2.alpha: [-2, 2]")))

    np.testing.assert_allclose(cell.bounds["j2.alpha"], np.radians([-2, 2]))


def test_base_and_tool_may_be_left_to_the_fit(write_cell):
    cell = read_cell(write_cell(re.sub(r"base: .*", "base: fit", CELL)))

    assert cell.base is None
    assert np.isinf(cell.prior[:6]).all()
    assert np.isfinite(cell.prior[6:]).all()
    assert np.isfinite(cell.scale).all()


def test_a_cell_names_a_urdf_by_its_file_and_two_links(write_cell, tmp_path):
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><joint name="a" type="continuous"><parent link="p"/><child link="c"/>'
        '<origin xyz="0 0 0.5"/></joint></robot>'
    )
    text = (
        change(CELL, "robot: robot.yaml", "robot: {urdf: arm.urdf, base: p, flange: c}")
        .replace("j2.a: ", "a.a: ")
        .replace("j1.beta", "a.beta")
    )

    cell = read_cell(write_cell(text))

    assert cell.robot.name == "arm"
    assert "arm.urdf" in cell.sources
    hose = text.replace("flange: c}", "flange: c, limits_deg: {a: [-170, 400]}}")
    joint = read_cell(write_cell(hose)).robot.joints[0]
    assert joint.lower == pytest.approx(np.radians(-170))
    assert joint.upper == cell.robot.joints[0].upper  # never beyond those of the URDF
    assert (
        "cell.yaml:1: joint 'a' turns: limits_deg" in mistakes(write_cell(hose.replace("limits_deg", "limits_mm")))[0]
    )
    assert "the robot has no joint 'b'; it has a" in mistakes(write_cell(hose.replace("{a:", "{b:")))[0]
    assert (
        "joint 'a' has nothing left between 500 and 600"
        in mistakes(write_cell(hose.replace("-170, 400", "500, 600")))[0]
    )
    assert "arm.urdf:0: no link 'q' for the base" in mistakes(write_cell(text.replace("base: p", "base: q")))[0]
    assert mistakes(write_cell(text.replace("arm.urdf", "leg.urdf"))) == [
        "cell.yaml:1: urdf file 'leg.urdf' does not exist beside cell.yaml"
    ]
    assert "cell.yaml:1: a URDF needs the two links" in mistakes(write_cell(CELL.replace("robot.yaml", "arm.urdf")))[0]


def test_a_cell_without_a_jig_is_valid(write_cell):
    assert read_cell(write_cell(change(CELL, "jig: jig.yaml\n", ""))).jig is None


@pytest.mark.parametrize("text", ["name: x\njoints: []\n", "name: x\njoints: 3\n", "name: x\njoints: [3, a]\n"])
def test_a_robot_without_joints_is_no_robot(write_cell, tmp_path, text):
    write_cell(robot=text)

    assert mistakes(tmp_path / "robot.yaml", read_robot)[0].startswith("robot.yaml:2: joints")


def test_mistakes_of_all_three_files_come_at_once(write_cell):
    cell = CELL.replace("sigma_mm", "sigma").replace("z_mm: 410", "z_mm: 0.41").replace("[0, 300]", "[300, 0]")
    robot = ROBOT.replace("{d_mm", "{d").replace("[-110, 130]", "[130, -110]").replace("link: 2", "link: 9")
    jig = JIG.replace("name: right", "name: top").replace("tolerance_mm", "tol").replace("boxes:", "boxs:")

    found = mistakes(write_cell(cell, robot, jig))

    assert [line.rsplit(":", 1)[0].split(": ")[0] for line in found] == [
        *("cell.yaml:4", "cell.yaml:7", "cell.yaml:8"),
        *("jig.yaml:3", "jig.yaml:4", "jig.yaml:5"),
        *("robot.yaml:3", "robot.yaml:4", "robot.yaml:7"),
    ]


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_mutilated_files_never_end_in_anything_but_a_sentence(write_cell, data):
    texts = [CELL, ROBOT, JIG]
    for _ in range(data.draw(st.integers(1, 3))):
        which = data.draw(st.integers(0, 2))
        lines = texts[which].split("\n")
        row = data.draw(st.integers(0, len(lines) - 1))
        column = data.draw(st.integers(0, len(lines[row])))
        word = data.draw(st.sampled_from(["", ":", "-", "[", "}", "null", "1e999", "'", "\t", "~", " x: 1", "é", "#"]))
        lines[row] = lines[row][:column] + word + lines[row][column + data.draw(st.integers(0, 9)) :]
        texts[which] = "\n".join(lines)
    path = write_cell(*texts)

    try:
        found = read_cell(path)
    except InputError as error:
        found = error

    if isinstance(found, InputError):
        assert found.mistakes
        assert all(m.file.startswith(str(path.parent)) for m in found.mistakes)
    else:
        assert np.isfinite(found.theta).all()
