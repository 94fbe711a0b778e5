"""Cells, robots and jigs from YAML: what is wrong comes all at once, one sentence each, with file and line."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from identify.model.files import InputError
from identify.model.io.description import library, read_cell, read_jig, read_robot
from identify.model.io.entries import cell_entry, cell_from_entry

CELL = """\
robot: robot.yaml
jig: jig.yaml
base: {x_mm: 340, y_mm: 740, z_mm: 350, rz_deg: -90}
tool:
  z_mm: 410
  ry_deg: -18
touch: {sigma_mm: 0.05, approach_mm: 25}
zone: {box_mm: [[0, 400], [0, 300], [0, 250]], max_tilt_deg: 60}
fixed: [j1.beta]
bounds: {j2.a: [340, 360]}
"""
ROBOT = """\
name: elbow
joints:
  - {d_mm: 400, alpha_deg: -90, limits_deg: [-160, 160]}
  - {a_mm: 350, limits_deg: [-110, 130], speed_deg_s: 100}
  - {type: prismatic, limits_mm: [0, 200], speed_mm_s: 300}
capsules:
  - {link: 2, start_mm: [0, 0, 0], end_mm: [0, 0, 100], radius_mm: 40}
"""
JIG = """\
name: corner
faces:
  - {name: top, origin_mm: [0, 0, 100], u_mm: [100, 0, 0], v_mm: [0, 100, 0], tolerance_mm: 0.02}
  - {name: right, origin_mm: [100, 0, 0], u_mm: [0, 100, 0], v_mm: [0, 0, 100]}
boxes:
  - {lower_mm: [0, 0, 0], upper_mm: [100, 100, 100]}
"""


@pytest.fixture
def write(tmp_path):
    """Writes the three files of a cell, each as given, and returns the path of cell.yaml."""

    def write(cell=CELL, robot=ROBOT, jig=JIG):
        for name, text in (("cell", cell), ("robot", robot), ("jig", jig)):
            (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
        return tmp_path / "cell.yaml"

    return write


def mistakes(path, read=read_cell):
    """Mistakes as "file:line: sentence", without folders."""
    with pytest.raises(InputError) as caught:
        read(path)
    return [f"{Path(m.file).name}:{m.line}: {m.text}" for m in caught.value.mistakes]


def change(text, old, new):
    assert old in text
    return text.replace(old, new)


def test_a_cell_is_understood_in_millimetres_and_radians(write):
    cell = read_cell(write())

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


def test_angles_in_bounds_are_degrees(write):
    cell = read_cell(write(change(CELL, "j2.a: [340, 360]", "j2.alpha: [-2, 2]")))

    np.testing.assert_allclose(cell.bounds["j2.alpha"], np.radians([-2, 2]))


def test_base_and_tool_may_be_left_to_the_fit(write):
    cell = read_cell(write(re.sub(r"base: .*", "base: fit", CELL)))

    assert cell.base is None
    assert np.isinf(cell.prior[:6]).all()
    assert np.isfinite(cell.prior[6:]).all()
    assert np.isfinite(cell.scale).all()


def test_a_cell_names_a_urdf_by_its_file_and_two_links(write, tmp_path):
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><joint name="a" type="continuous"><parent link="p"/><child link="c"/>'
        '<origin xyz="0 0 0.5"/></joint></robot>'
    )
    text = (
        change(CELL, "robot: robot.yaml", "robot: {urdf: arm.urdf, base: p, flange: c}")
        .replace("j2.a: ", "a.a: ")
        .replace("j1.beta", "a.beta")
    )

    cell = read_cell(write(text))

    assert cell.robot.name == "arm"
    assert "arm.urdf" in cell.sources
    hose = text.replace("flange: c}", "flange: c, limits_deg: {a: [-170, 400]}}")
    joint = read_cell(write(hose)).robot.joints[0]
    assert joint.lower == pytest.approx(np.radians(-170))
    assert joint.upper == cell.robot.joints[0].upper  # never beyond those of the URDF
    assert "cell.yaml:1: joint 'a' turns: limits_deg" in mistakes(write(hose.replace("limits_deg", "limits_mm")))[0]
    assert "the robot has no joint 'b'; it has a" in mistakes(write(hose.replace("{a:", "{b:")))[0]
    assert "joint 'a' has nothing left between 500 and 600" in mistakes(write(hose.replace("-170, 400", "500, 600")))[0]
    assert "arm.urdf:0: no link 'q' for the base" in mistakes(write(text.replace("base: p", "base: q")))[0]
    assert mistakes(write(text.replace("arm.urdf", "leg.urdf"))) == [
        "cell.yaml:1: urdf file 'leg.urdf' does not exist beside cell.yaml"
    ]
    assert "cell.yaml:1: a URDF needs the two links" in mistakes(write(CELL.replace("robot.yaml", "arm.urdf")))[0]


def test_a_cell_without_a_jig_is_valid(write):
    assert read_cell(write(change(CELL, "jig: jig.yaml\n", ""))).jig is None


CELL_MISTAKES = {
    "unknown key": ("sigma_mm: 0.05", "sigma: 0.05", "7: unknown key 'touch.sigma'; did you mean 'sigma_mm'?"),
    "unknown key at the top": ("fixed:", "fixd:", "9: unknown key 'fixd'; did you mean 'fixed'?"),
    "not a number": ("x_mm: 340", "x_mm: .nan", "3: base.x_mm is nan: "),
    "infinite": ("x_mm: 340", "x_mm: .inf", "3: base.x_mm is inf: "),
    "decimal comma": ("z_mm: 410", "z_mm: 410,5", "5: tool.z_mm is '410,5': "),
    "truth for a number": ("z_mm: 410", "z_mm: true", "5: tool.z_mm is True: "),
    "negative": ("sigma_mm: 0.05", "sigma_mm: -0.05", "7: touch.sigma_mm is -0.05: "),
    "missing key": ("robot: robot.yaml\n", "", "1: key 'robot' is missing"),
    "nothing at a key": ("base: {x_mm: 340, y_mm: 740, z_mm: 350, rz_deg: -90}", "base:", "3: base is None: "),
    "no such file": ("jig: jig.yaml", "jig: jug.yaml", "2: jig file 'jug.yaml' does not exist beside cell.yaml"),
    "a folder": ("jig: jig.yaml", "jig: .", "2: jig file '.' does not exist beside cell.yaml"),
    "not in the library": ("robot: robot.yaml", "robot: library:irb121", "1: the library has no robot 'irb121'; did"),
    "base in metres": ("x_mm: 340, y_mm: 740, z_mm: 350", "x_mm: 0.34, y_mm: 0.74", "3: base lies within 5 mm of its"),
    "tool in metres": ("z_mm: 410", "z_mm: 0.41", "4: tool lies within 5 mm of its origin: metres?"),
    "base in radians": ("rz_deg: -90", "rz_deg: -1.5708", "3: rz_deg is -1.5708: radians?"),
    "approach in metres": ("approach_mm: 25", "approach_mm: 0.025", "7: approach_mm is 0.025: metres?"),
    "zone in metres": ("[[0, 400], [0, 300], [0, 250]]", "[[0, 0.4], [0, 0.3], [0, 0.2]]", "8: the zone lies within 5"),
    "zone turned around": ("[0, 300]", "[300, 0]", "8: zone box: y runs from 300 to 0; write the smaller first"),
    "zone of two axes": ("[[0, 400], [0, 300], [0, 250]]", "[[0, 400], [0, 300]]", "8: key 'zone.box_mm.2' is missing"),
    "tilt in radians": ("max_tilt_deg: 60", "max_tilt_deg: 1.05", "8: a tilt of 1.05 degrees: radians?"),
    "unknown fixed": ("[j1.beta]", "[j1.betta]", "9: fixed: the robot has no parameter 'j1.betta'; did you mean 'j1.b"),
    "unknown bound": ("j2.a:", "j9.a:", "10: bounds: the robot has no parameter 'j9.a'"),
    "bounds turned around": ("[340, 360]", "[360, 340]", "10: bounds of j2.a run from 360 to 340"),
    "key twice": ("jig: jig.yaml", "jig: jig.yaml\njig: jig.yaml", '3: not valid YAML: found duplicate key "jig"'),
    "broken YAML": ("tool:\n", "tool: [\n", "6: not valid YAML: "),
    "shape": ("touch: {sigma_mm: 0.05, approach_mm: 25}", "wire: {shape: square}", "7: wire.shape is 'square': "),
    "fit misspelt": ("base: {x_mm: 340, y_mm: 740, z_mm: 350, rz_deg: -90}", "base: fitt", "3: base is 'fitt': "),
}


@pytest.mark.parametrize("case", CELL_MISTAKES)
def test_a_mistake_in_a_cell_has_its_line_and_one_sentence(write, case):
    old, new, sentence = CELL_MISTAKES[case]

    found = mistakes(write(change(CELL, old, new)))

    assert len(found) == 1
    assert found[0].startswith(f"cell.yaml:{sentence}")


ROBOT_MISTAKES = {
    "unknown key": ("d_mm: 400", "d: 400", "3: unknown key 'joints.0.d'; did you mean 'd_mm'?"),
    "limits missing": (", limits_deg: [-160, 160]", "", "3: joint 1 needs limits_deg: [lower, upper]"),
    "limits turned around": ("[-160, 160]", "[160, -160]", "3: joint 1: limits run from 160 to -160"),
    "limits in radians": ("[-160, 160]", "[-2.8, 2.8]", "3: joint 1: limits within 7 degrees: radians?"),
    "angle in radians": ("alpha_deg: -90", "alpha_deg: -1.5708", "3: alpha_deg is -1.5708: radians?"),
    "wrong unit": ("limits_mm: [0, 200]", "limits_mm: [0, 200], limits_deg: [0, 90]", "5: joint 3 is prismatic: write"),
    "half a limit": ("[-160, 160]", "[-160]", "3: key 'joints.0.limits_deg.1' is missing"),
    "unknown type": ("type: prismatic", "type: linear", "5: joints.2.type is 'linear': "),
    "name taken": ("{type: prismatic", "{name: j1, type: prismatic", "5: joint name 'j1' is taken"),
    "name with a dot": ("{type: prismatic", "{name: a.b, type: prismatic", "5: joint name 'a.b' is taken or has a dot"),
    "name of the tool": ("{type: prismatic", "{name: tool, type: prismatic", "5: joint name 'tool' is taken"),
    "no such link": ("link: 2", "link: 4", "7: link 4 does not exist; the last is 3"),
    "speed zero": ("speed_deg_s: 100", "speed_deg_s: 0", "4: joints.1.speed_deg_s is 0: "),
}


@pytest.mark.parametrize("case", ROBOT_MISTAKES)
def test_a_mistake_in_a_robot_has_its_line_and_one_sentence(write, tmp_path, case):
    old, new, sentence = ROBOT_MISTAKES[case]
    write(robot=change(ROBOT, old, new))

    found = mistakes(tmp_path / "robot.yaml", read_robot)

    assert len(found) == 1
    assert found[0].startswith(f"robot.yaml:{sentence}")


def test_a_robot_in_metres_is_recognised(write, tmp_path):
    write(robot=ROBOT.replace("400", "0.4").replace("350", "0.35"))

    assert mistakes(tmp_path / "robot.yaml", read_robot) == [
        "robot.yaml:2: no link is longer than 0.4 mm: metres? write millimetres"
    ]


@pytest.mark.parametrize("text", ["name: x\njoints: []\n", "name: x\njoints: 3\n", "name: x\njoints: [3, a]\n"])
def test_a_robot_without_joints_is_no_robot(write, tmp_path, text):
    write(robot=text)

    assert mistakes(tmp_path / "robot.yaml", read_robot)[0].startswith("robot.yaml:2: joints")


JIG_MISTAKES = {
    "unknown key": ("tolerance_mm: 0.02", "tol_mm: 0.02", "3: unknown key 'faces.0.tol_mm'; did you mean 'toler"),
    "twice": ("name: right", "name: top", "4: face 'top' is named twice"),
    "no name": ("name: right", "name: ''", "4: faces.1.name is '': "),
    "no area": ("u_mm: [100, 0, 0]", "u_mm: [0, 50, 0]", "3: face 'top': u and v span no area"),
    "no length": ("u_mm: [100, 0, 0]", "u_mm: [0, 0, 0]", "3: face 'top': u and v span no area"),
    "slanted": ("u_mm: [100, 0, 0]", "u_mm: [100, 1, 0]", "3: face 'top': u and v are not at right angles"),
    "two numbers": ("u_mm: [100, 0, 0]", "u_mm: [100, 0]", "3: key 'faces.0.u_mm.2' is missing"),
    "box turned around": ("lower_mm: [0, 0, 0]", "lower_mm: [0, 0, 200]", "6: lower_mm is not below upper_mm"),
    "negative tolerance": ("tolerance_mm: 0.02", "tolerance_mm: -1", "3: faces.0.tolerance_mm is -1: "),
}


@pytest.mark.parametrize("case", JIG_MISTAKES)
def test_a_mistake_in_a_jig_has_its_line_and_one_sentence(write, tmp_path, case):
    old, new, sentence = JIG_MISTAKES[case]
    write(jig=change(JIG, old, new))

    found = mistakes(tmp_path / "jig.yaml", read_jig)

    assert len(found) == 1
    assert found[0].startswith(f"jig.yaml:{sentence}")


def test_a_jig_in_metres_is_recognised(write, tmp_path):
    write(jig=JIG.replace("100", "0.1"))

    assert mistakes(tmp_path / "jig.yaml", read_jig) == [
        "jig.yaml:2: no face is larger than 5 mm: metres? write millimetres"
    ]


def test_mistakes_of_all_three_files_come_at_once(write):
    cell = CELL.replace("sigma_mm", "sigma").replace("z_mm: 410", "z_mm: 0.41").replace("[0, 300]", "[300, 0]")
    robot = ROBOT.replace("{d_mm", "{d").replace("[-110, 130]", "[130, -110]").replace("link: 2", "link: 9")
    jig = JIG.replace("name: right", "name: top").replace("tolerance_mm", "tol").replace("boxes:", "boxs:")

    found = mistakes(write(cell, robot, jig))

    assert [line.rsplit(":", 1)[0].split(": ")[0] for line in found] == [
        *("cell.yaml:4", "cell.yaml:7", "cell.yaml:8"),
        *("jig.yaml:3", "jig.yaml:4", "jig.yaml:5"),
        *("robot.yaml:3", "robot.yaml:4", "robot.yaml:7"),
    ]


def test_a_joint_with_an_unknown_key_is_still_checked_for_its_units(write, tmp_path):
    write(robot=ROBOT.replace("d_mm: 400", "d: 400").replace("[-160, 160]", "[-2.8, 2.8]"))

    found = mistakes(tmp_path / "robot.yaml", read_robot)

    assert [line.split(": ")[0] for line in found] == ["robot.yaml:3", "robot.yaml:3"]


@pytest.mark.parametrize(
    ("content", "line", "sentence"),
    [
        (b"", 1, "expected keys such as robot, jig, base"),
        (b"# nothing but a comment\n", 1, "expected keys such as robot, jig, base"),
        (b"- robot\n- jig\n", 1, "expected keys such as"),
        (b"just words\n", 1, "expected keys such as"),
        (b"robot: \xff\xfe\n", 0, "not a text file in UTF-8 (byte 7); save it as UTF-8"),
        (b"\x00\x01\x02\x03", 1, "not valid YAML: "),
        (b"robot: a\x07b\n", 1, "not valid YAML: "),
        (b"a: &x [*x]\n", 1, "unknown key 'a'"),
        (b"robot: !!python/object:os.system ls\n", 1, ""),
        (b"--- \nrobot: a\n---\nrobot: b\n", 3, "not valid YAML: "),
        (b"robot: 2001-13-45\n", 0, "not valid YAML: month must be in 1..12"),
        (b"[" * 1000, 0, "brackets stand more than 50 deep; close them"),
        (b"1: 2\n", 1, ""),
        (b"? [a, b]\n: 2\n", 1, ""),
    ],
)
def test_what_is_no_cell_file_is_said_so(tmp_path, content, line, sentence):
    (tmp_path / "cell.yaml").write_bytes(content)

    found = mistakes(tmp_path / "cell.yaml")

    assert any(text.startswith(f"cell.yaml:{line}: {sentence}") for text in found), found


def test_a_missing_cell_file_is_said_so(tmp_path):
    assert mistakes(tmp_path / "cell.yaml") == ["cell.yaml:0: no such file; check the name and the folder"]


def test_byte_order_mark_and_line_ends_of_windows_are_read(write):
    path = write()
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))

    assert read_cell(path).bounds == {"j2.a": (340, 360)}
    path.write_bytes(path.read_bytes().replace(b"z_mm: 410", b"z_mm: x"))
    assert mistakes(path)[0].startswith("cell.yaml:5: tool.z_mm is 'x'")


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_mutilated_files_never_end_in_anything_but_a_sentence(write, data):
    texts = [CELL, ROBOT, JIG]
    for _ in range(data.draw(st.integers(1, 3))):
        which = data.draw(st.integers(0, 2))
        lines = texts[which].split("\n")
        row = data.draw(st.integers(0, len(lines) - 1))
        column = data.draw(st.integers(0, len(lines[row])))
        word = data.draw(st.sampled_from(["", ":", "-", "[", "}", "null", "1e999", "'", "\t", "~", " x: 1", "é", "#"]))
        lines[row] = lines[row][:column] + word + lines[row][column + data.draw(st.integers(0, 9)) :]
        texts[which] = "\n".join(lines)
    path = write(*texts)

    try:
        found = read_cell(path)
    except InputError as error:
        found = error

    if isinstance(found, InputError):
        assert found.mistakes
        assert all(m.file.startswith(str(path.parent)) for m in found.mistakes)
    else:
        assert np.isfinite(found.theta).all()


@pytest.mark.parametrize("name", library("cells"))
def test_a_cell_written_into_one_document_comes_back_the_same(name):
    cell = read_cell(library("cells")[name])

    again = cell_from_entry(cell_entry(cell), dict(cell.sources))

    np.testing.assert_allclose(again.theta, cell.theta, rtol=1e-14)
    np.testing.assert_allclose(again.prior, cell.prior, rtol=1e-14)
    assert again.robot.joints[0].name == cell.robot.joints[0].name
    assert [face.name for face in again.jig.faces] == [face.name for face in cell.jig.faces]
    assert cell_entry(again)["zone"] == cell_entry(cell)["zone"]


def test_the_ends_of_a_urdf_survive_being_written_into_one_document(write, tmp_path):
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><joint name="a" type="continuous"><parent link="p"/><child link="c"/>'
        '<origin xyz="0.1 0.2 0.5" rpy="0.1 1.5707963 0.3"/><axis xyz="1 2 3"/></joint>'
        '<joint name="b" type="fixed"><parent link="c"/><child link="d"/><origin rpy="1 2 3" xyz="0 0.1 0"/></joint>'
        "</robot>"
    )
    text = change(CELL, "robot: robot.yaml", "robot: {urdf: arm.urdf, base: p, flange: d}").replace("j2.a: ", "a.a: ")
    text = text.replace("j1.beta", "a.beta")
    cell = read_cell(write(text))

    again = cell_from_entry(cell_entry(cell), {})

    np.testing.assert_allclose(again.robot.base_T_first, cell.robot.base_T_first, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(again.robot.last_T_flange, cell.robot.last_T_flange, rtol=1e-12, atol=1e-12)
