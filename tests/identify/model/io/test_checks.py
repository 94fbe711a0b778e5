"""What is wrong in a cell, a robot or a jig has its line and one sentence."""

import pytest
from cell_texts import CELL, JIG, ROBOT, change, mistakes

from identify.model.io.description import read_jig, read_robot

CELL_MISTAKES = {
    "unknown key": ("sigma_mm: 0.05", "sigma: 0.05", "7: unknown key 'touch.sigma'; did you mean 'sigma_mm'?"),
    "unknown key at the top": ("fixed:", "fixd:", "9: unknown key 'fixd'; did you mean 'fixed'?"),
    "not a number": ("x_mm: 340", "x_mm: .nan", "3: base.x_mm is nan: "),
    "infinite": ("x_mm: 340", "x_mm: .inf", "3: base.x_mm is inf: "),
    "decimal comma": ("z_mm: 410", "z_mm: 410,5", "5: 410,5 has a decimal comma; write 410.5"),
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
    "tool in radians": ("ry_deg: -18", "ry_deg: -0.785", "6: ry_deg is -0.785: radians?"),
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
def test_a_mistake_in_a_cell_has_its_line_and_one_sentence(write_cell, case):
    old, new, sentence = CELL_MISTAKES[case]

    found = mistakes(write_cell(change(CELL, old, new)))

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
def test_a_mistake_in_a_robot_has_its_line_and_one_sentence(write_cell, tmp_path, case):
    old, new, sentence = ROBOT_MISTAKES[case]
    write_cell(robot=change(ROBOT, old, new))

    found = mistakes(tmp_path / "robot.yaml", read_robot)

    assert len(found) == 1
    assert found[0].startswith(f"robot.yaml:{sentence}")


def test_a_robot_in_metres_is_recognised(write_cell, tmp_path):
    write_cell(robot=ROBOT.replace("400", "0.4").replace("350", "0.35"))

    assert mistakes(tmp_path / "robot.yaml", read_robot) == [
        "robot.yaml:2: no link is longer than 0.4 mm: metres? write millimetres"
    ]


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
def test_a_mistake_in_a_jig_has_its_line_and_one_sentence(write_cell, tmp_path, case):
    old, new, sentence = JIG_MISTAKES[case]
    write_cell(jig=change(JIG, old, new))

    found = mistakes(tmp_path / "jig.yaml", read_jig)

    assert len(found) == 1
    assert found[0].startswith(f"jig.yaml:{sentence}")


def test_a_jig_in_metres_is_recognised(write_cell, tmp_path):
    write_cell(jig=JIG.replace("100", "0.1"))

    assert mistakes(tmp_path / "jig.yaml", read_jig) == [
        "jig.yaml:2: no face is larger than 5 mm: metres? write millimetres"
    ]


def test_a_joint_with_an_unknown_key_is_still_checked_for_its_units(write_cell, tmp_path):
    write_cell(robot=ROBOT.replace("d_mm: 400", "d: 400").replace("[-160, 160]", "[-2.8, 2.8]"))

    found = mistakes(tmp_path / "robot.yaml", read_robot)

    assert [line.split(": ")[0] for line in found] == ["robot.yaml:3", "robot.yaml:3"]
