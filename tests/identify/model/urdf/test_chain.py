"""Any chain of a URDF moves as its own semantics say, joint values kept; what is wrong is said with its line."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import forward
from scipy.spatial.transform import Rotation
from urdf_stages import Stage, assert_same, chains, mistakes, model, right_angles, semantics, urdf, written

from identify.model.files import InputError
from identify.model.io.description import library, read_robot
from identify.model.kinematics import Kinematics
from identify.model.urdf.chain import read_urdf


def inside(robot, q):
    """Joint values of a URDF [rad] or [m] in the units of the model [rad] or [mm]."""
    return np.where(robot.prismatic, 1000.0, 1.0) * q


@settings(max_examples=150)
@given(stages=chains, data=st.data())
def test_a_robot_moves_as_its_urdf_says(folder, stages, data):
    robot = model(folder, stages)
    moves = len(robot.joints)

    for _ in range(3):
        q = np.array(data.draw(st.lists(right_angles | st.floats(-4, 4), min_size=moves, max_size=moves)))
        T = forward(robot, inside(robot, q), robot.theta(np.zeros(6), np.zeros(6)))

        assert_same(T, semantics(stages, q), stages)


@settings(max_examples=20)
@given(stages=chains)
def test_the_compiled_kinematics_of_a_urdf_moves_as_its_urdf_says(folder, stages):
    robot = model(folder, stages)
    q = np.linspace(-1.4, 1.9, len(robot.joints))

    position, R = Kinematics(robot).flange(inside(robot, q), robot.theta(np.ones(6), np.ones(6)))

    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R[0], position[0]
    assert_same(T, semantics(stages, q), stages)


@pytest.mark.parametrize("name", ["arc-welder", "puma560", "arm7"])
def test_a_urdf_drawn_from_a_table_gives_the_table_back(folder, name):
    table = read_robot(library("robots")[name])
    stages, before = [], Stage("fixed")
    for joint in table.joints:
        stages.append(Stage("revolute", before.xyz, before.rpy))
        turn = Rotation.from_rotvec([0, 0, joint.theta])
        R = turn * Rotation.from_rotvec([joint.alpha, 0, 0]) * Rotation.from_rotvec([0, joint.beta, 0])
        shift = turn.apply([joint.a, 0, joint.d]) / 1000
        before = Stage("fixed", tuple(shift.tolist()), tuple(R.as_euler("xyz").tolist()))

    robot = model(folder, [*stages, before])

    np.testing.assert_allclose([j.link for j in robot.joints], [j.link for j in table.joints], atol=1e-9)
    assert np.array_equal(robot.base_T_first, np.eye(4))
    assert np.array_equal(robot.last_T_flange, np.eye(4))


def test_limits_and_speeds_become_millimetres_and_radians(folder):
    robot = model(folder, [Stage("revolute"), Stage("prismatic"), Stage("continuous")])

    assert [joint.name for joint in robot.joints] == ["j1", "j2", "j3"]
    assert robot.prismatic == (False, True, False)
    np.testing.assert_allclose(robot.lower, [-1.5, -1500, -2 * np.pi])
    np.testing.assert_allclose(robot.upper, [2, 2000, 2 * np.pi])
    np.testing.assert_allclose(robot.speed, [1.25, 1250, 1.25])


def test_a_chain_may_begin_and_end_anywhere_on_the_tree(folder):
    stages = [Stage("fixed", (0.1, 0.2, 0.3), (1, 2, 3)), Stage("revolute", (0, 0, 1)), Stage("revolute", (1, 0, 0))]
    path = written(folder, urdf(stages))
    T = semantics(stages, [0.0, 0.5])
    side = stages[0].origin() @ Stage("fixed", (9, 9, 9)).origin()  # the camera hangs on L1, beside the arm
    side[:3, 3] *= 1000

    robot = read_urdf(path, "camera", "L3")

    base_T_flange = forward(robot, np.array([0.0, 0.5]), robot.theta(np.zeros(6), np.zeros(6)))
    np.testing.assert_allclose(side @ base_T_flange, T, atol=1e-9)
    assert len(read_urdf(path, "L2", "L3").joints) == 1


def test_what_a_urdf_leaves_out_takes_its_default(folder):
    text = """<robot>
      <joint name="a" type="revolute"><parent link="p"/><child link="c"/><limit lower="-1" upper="1"/></joint>
      <joint name="b" type="prismatic"><parent link="c"/><child link="d"/><origin xyz="0 0 1"/>
        <limit lower="0" upper="0.2" velocity="0"/></joint>
    </robot>"""

    robot = read_urdf(written(folder, text, "nameless.urdf"), "p", "d")

    T = forward(robot, np.array([0.3, 50.0]), robot.theta(np.zeros(6), np.zeros(6)))
    stages = [Stage("revolute", axis=(1, 0, 0)), Stage("prismatic", (0, 0, 1), axis=(1, 0, 0))]
    np.testing.assert_allclose(T, semantics(stages, [0.3, 0.05]), atol=1e-9)
    np.testing.assert_allclose(robot.speed, [np.pi / 2, 500])  # 90 deg/s and 500 mm/s, as in robot.yaml
    assert robot.name == "nameless"


JOINT = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/>{}</joint>'


LIMIT = '<limit lower="-1" upper="1" velocity="1"/>'


def body(*joints):
    return "\n".join(["<robot>", *(JOINT.format(*joint) for joint in joints), "</robot>"])


GOOD = ("j1", "revolute", "a", "b", LIMIT)


BAD = {
    "planar": (("j2", "planar", "b", "c", LIMIT), "joint 'j2' is planar, expected fixed, revolute"),
    "floating": (("j2", "floating", "b", "c", ""), "joint 'j2' is floating, expected"),
    "no type": (("j2", "", "b", "c", LIMIT), "joint 'j2' is of no type, expected"),
    "mimic": (("j2", "revolute", "b", "c", LIMIT + '<mimic joint="j1"/>'), "joint 'j2' mimics another"),
    "zero axis": (("j2", "revolute", "b", "c", LIMIT + '<axis xyz="0 0 0"/>'), "joint 'j2': the axis is zero"),
    "two numbers": (("j2", "revolute", "b", "c", LIMIT + '<axis xyz="0 1"/>'), "xyz is '0 1', expected 3 numbers"),
    "words": (("j2", "fixed", "b", "c", '<origin xyz="a b c"/>'), "xyz is 'a b c', expected 3 numbers"),
    "not finite": (("j2", "fixed", "b", "c", '<origin rpy="0 nan 0"/>'), "rpy is '0 nan 0', expected 3 numbers"),
    "xacro": (("j2", "fixed", "b", "c", '<origin xyz="0 0 ${h}"/>'), "run xacro first"),
    "millimetres": (("j2", "fixed", "b", "c", '<origin xyz="0 0 350"/>'), "an offset of 350 m: millimetres?"),
    "stroke": (("j2", "prismatic", "b", "c", '<limit lower="0" upper="200"/>'), "a stroke of 200 m: millimetres?"),
    "degrees": (("j2", "revolute", "b", "c", '<limit lower="-90" upper="90"/>'), "a limit of 90 rad: degrees?"),
    "rpy degrees": (("j2", "fixed", "b", "c", '<origin rpy="0 90 0"/>'), "rpy is 90 rad: degrees?"),
    "no limits": (("j2", "revolute", "b", "c", ""), "joint 'j2' has no limits; write <limit"),
    "limit word": (("j2", "revolute", "b", "c", '<limit lower="-1" upper="x"/>'), "upper is 'x', expected a number"),
    "reversed": (("j2", "revolute", "b", "c", '<limit lower="1" upper="-1"/>'), "limits run from 1 to -1"),
    "no child": (("j2", "revolute", "b", "", LIMIT), "joint 'j2' does not join two links"),
    "two parents": (("j2", "fixed", "a", "b", ""), "link 'b' hangs on joint 'j2' and on 'j1'"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_joint_that_cannot_be_used_is_named_with_its_line(folder, case):
    joint, sentence = BAD[case]

    found = mistakes(folder, body(GOOD, joint), flange="b" if joint[3] in {"", "b"} else "c")

    assert len(found) == 1
    assert found[0][0] == 3
    assert sentence in found[0][1]


def test_every_mistake_of_a_chain_comes_at_once(folder):
    text = body(("j1", "planar", "a", "b", ""), ("j2", "revolute", "b", "c", '<origin xyz="0 0 350"/>'))

    found = mistakes(folder, text)

    assert [line for line, _ in found] == [2, 3, 3]


@pytest.mark.parametrize(
    ("base", "flange", "sentence"),
    [
        ("aa", "b", "no link 'aa' for the base; did you mean 'a'?"),
        ("a", "tool0", "no link 'tool0' for the flange; its links: a, b, c, d, e"),
        ("a", "e", "no chain of joints joins 'a' and 'e'"),
        ("a", "a", "no joint moves between 'a' and 'a'"),
        ("b", "c", "no joint moves between 'b' and 'c'"),
    ],
)
def test_links_without_a_usable_chain_between_them_are_named(folder, base, flange, sentence):
    text = body(GOOD, ("j2", "fixed", "b", "c", ""), ("j3", "revolute", "d", "e", LIMIT))

    assert sentence in mistakes(folder, text, base, flange)[0][1]


WORKCELL = """<robot name="workcell">
  <joint name="tilt" type="revolute"><parent link="world"/><child link="cradle"/>
    <origin xyz="1.2 0.3 0.7" rpy="0.1 0.2 -0.4"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" velocity="1"/></joint>
  <joint name="turn" type="continuous"><parent link="cradle"/><child link="table"/>
    <origin xyz="0.01 0.02 0.15" rpy="0.02 -0.01 0.3"/><axis xyz="0 0 -1"/></joint>
  <joint name="track" type="prismatic"><parent link="world"/><child link="carriage"/>
    <origin xyz="-0.5 -1 0.1"/><axis xyz="1 0.1 0"/><limit lower="0" upper="3" velocity="1"/></joint>
  <joint name="stand" type="fixed"><parent link="carriage"/><child link="base"/>
    <origin rpy="0 0 1.5" xyz="0 0 0.4"/></joint>
  <joint name="a.1" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.3"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2"/></joint>
  <joint name="a2" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.2 0 0.6"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2"/></joint>
  <joint name="mount" type="fixed"><parent link="fore"/><child link="tool0"/>
    <origin rpy="0 1.6 0" xyz="0.7 0 0"/></joint>
</robot>"""


def place_on_tree(link, values):
    """Where a link of the workcell stands in the world [m], joint by joint, by SciPy's rotations."""
    joints = {j.find("child").get("link"): j for j in ET.fromstring(WORKCELL).iter("joint")}
    T = np.eye(4)
    while link in joints:
        joint = joints[link]
        numbers = {key: np.zeros(3) for key in ("xyz", "rpy")}
        origin = joint.find("origin")
        numbers |= {key: np.array([float(word) for word in text.split()]) for key, text in origin.attrib.items()}
        step, move = np.eye(4), np.eye(4)
        step[:3, :3], step[:3, 3] = Rotation.from_euler("xyz", numbers["rpy"]).as_matrix(), numbers["xyz"]
        if joint.get("type") != "fixed":
            axis = np.array([float(word) for word in joint.find("axis").get("xyz").split()])
            along = values[joint.get("name")] * axis / np.linalg.norm(axis)
            if joint.get("type") == "prismatic":
                move[:3, 3] = along
            else:
                move[:3, :3] = Rotation.from_rotvec(along).as_matrix()
        T, link = step @ move @ T, joint.find("parent").get("link")
    return T


@pytest.mark.parametrize(
    ("base", "flange", "names"),
    [
        ("table", "tool0", ["turn", "tilt", "track", "j4", "a2"]),
        ("tool0", "table", ["a2", "j2", "track", "tilt", "turn"]),
        ("cradle", "upper", ["tilt", "track", "j3"]),
    ],
)
def test_a_chain_climbs_through_moving_joints_and_descends_again(folder, rng, base, flange, names):
    robot = read_urdf(written(folder, WORKCELL), base, flange)
    kinematics = Kinematics(robot)

    for q in rng.uniform(robot.lower, robot.upper, (20, len(names))):
        values = dict(zip(["a.1" if name in ("j2", "j3", "j4") else name for name in names], q, strict=True))
        values["track"] /= 1000.0  # [m]
        expected = np.linalg.inv(place_on_tree(base, values)) @ place_on_tree(flange, values)
        p, R = kinematics.flange(q[None], robot.theta(np.zeros(6), np.zeros(6)))
        np.testing.assert_allclose(p[0], 1000 * expected[:3, 3], atol=1e-8)
        np.testing.assert_allclose(R[0], expected[:3, :3], atol=1e-12)
    assert [joint.name for joint in robot.joints] == names


def test_a_loop_is_no_chain(folder):
    text = body(("j1", "fixed", "a", "b", ""), ("j2", "fixed", "b", "a", ""))

    assert "closes a loop" in mistakes(folder, text, "a", "b")[0][1]


def test_mutilated_urdfs_never_end_in_anything_but_a_sentence(folder, rng):
    text = urdf([Stage("revolute", (0, 0, 0.3)), Stage("fixed"), Stage("prismatic", (0.2, 0, 0))])
    words = ["", "0", "nan", "-", '"', "<", ">", "/>", "L1", "é", "1e999"]

    for _ in range(300):
        a, b = sorted(rng.integers(0, len(text), 2))
        wounded = text[:a] + words[rng.integers(len(words))] + text[min(b, a + 12) :]
        try:
            robot = read_urdf(written(folder, wounded), "L0", "L3")
        except InputError:
            continue
        assert np.isfinite(robot.links).all()
