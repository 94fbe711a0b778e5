"""Every format reads back as the identified robot, by readers that share no line with what wrote it."""

import csv
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st
from identified import identified
from measured import table_2
from oracle import forward
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from identify.export.exporting import FORMATS, ends_of, export
from identify.export.formats import Original
from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.frames import transform
from identify.model.io.description import library, read_robot
from identify.model.urdf.chain import read_urdf

MICRO = 1e-6  # [mm]
ROBOTS = ("arc-welder", "irb120", "puma560", "arm7", "scara")


def cell_of(robot):
    return Cell(robot, None, np.array([340.0, 740, 350, -1.5, 0.1, 0.05]), np.array([5.0, -3, 410, 0.2, -0.3, 0.1]))


def wrong(cell, rng):
    """A calibration of a robot none of whose parameters is nominal."""
    spread = np.where(cell.robot.angular, np.radians(0.5), 2.0)
    return identified(cell, cell.theta + spread * rng.standard_normal(len(cell.theta)))


def draws(robot, rng, count=20):
    return rng.uniform(robot.lower, robot.upper, (count, len(robot.joints)))


def numbers(text):
    return np.array([float(word) for word in text.split()])


def placed(element):
    """The transform of an origin element, metres [URDF specification: fixed axes roll, pitch, yaw]."""
    T = np.eye(4)
    if element is not None:
        T[:3, 3] = numbers(element.get("xyz", "0 0 0"))
        T[:3, :3] = Rotation.from_euler("xyz", numbers(element.get("rpy", "0 0 0"))).as_matrix()
    return T


def urdf_forward(text, base, tip, values):
    """base_T_tip [mm] of a URDF at joint values [rad, mm] by joint name: a reader of its own."""
    root = ET.fromstring(text)
    above = {joint.find("child").get("link"): joint for joint in root.iterfind("joint")}

    def from_root(link):
        T = np.eye(4)
        while link in above:
            joint = above[link]
            motion, axis = np.eye(4), joint.find("axis")
            direction = np.array([1.0, 0, 0]) if axis is None else numbers(axis.get("xyz"))
            value = values.get(joint.get("name"), 0.0)
            if joint.get("type") == "prismatic":
                motion[:3, 3] = direction / np.linalg.norm(direction) * value / 1000
            elif joint.get("type") != "fixed":
                motion[:3, :3] = Rotation.from_rotvec(direction / np.linalg.norm(direction) * value).as_matrix()
            T = placed(joint.find("origin")) @ motion @ T
            link = joint.find("parent").get("link")
        return T

    T = np.linalg.inv(from_root(base)) @ from_root(tip)
    T[:3, 3] *= 1000
    return T


def assert_same(found, calibration, rng, tolerance=MICRO):
    """The identified forward kinematics, by the oracle, at joint values drawn within the limits."""
    robot = calibration.cell.robot
    for q in draws(robot, rng):
        T = forward(robot, q, calibration.theta)
        assert np.abs(found(q)[:3, 3] - T[:3, 3]).max() < tolerance
        assert np.abs(found(q)[:3, :3] - T[:3, :3]).max() < 1e-9


@pytest.mark.parametrize("name", ROBOTS)
def test_a_plain_urdf_moves_as_the_identified_robot(name, rng):
    calibration = wrong(cell_of(read_robot(library("robots")[name])), rng)
    names = [joint.name for joint in calibration.cell.robot.joints]

    result = export(calibration, "urdf")

    text = result.files[".urdf"]
    assert result.deviation.max_mm < MICRO
    assert_same(
        lambda q: urdf_forward(text, "touchcal_jig", "touchcal_tip", dict(zip(names, q, strict=True))), calibration, rng
    )


URDF = """<?xml version="1.0"?>
<!-- an arm with <origin xyz="9 9 9"/> in a comment -->
<robot name="arm" xmlns:xacro="x">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="world"/>
  <joint name="stand" type="fixed"><parent link="world"/><child link="base_link"/><origin xyz="0 0 1"/></joint>
  <link name="base_link">
    <visual><origin xyz="0 0 0.1" rpy="0 0 0"/><geometry><mesh filename="b.stl"/></geometry></visual></link>
  <joint name='a 1' type='revolute' >
    <origin rpy='0 0 0'
            xyz = '0 0 0.29'   />
    <parent link="base_link"/><child link="l1"/>
    <axis xyz="0 0 -1"/><limit lower="-2.8" upper="2.8" velocity="2" effort="10"/>
    <dynamics damping="0.1"/>
  </joint>
  <link name="l1"/>
  <joint name="a2" type="revolute"><parent link="l1"/><child link="l2"/>
    <axis xyz="0 1 0"/><limit lower="-1.9" upper="1.9" velocity="2" effort="10"/></joint>
  <link name="l2"/>
  <joint name="spacer" type="fixed"><parent link="l2"/><child link="l2b"/>
    <origin xyz="0 0.02 0.1" rpy="0.1 0 0.2"/></joint>
  <link name="l2b"/>
  <joint name="a3" type="prismatic"><origin xyz="0.01 0 0.27"/><parent link="l2b"/><child link="l3"/>
    <axis xyz="1 0 1"/><limit lower="0" upper="0.4" velocity="0.5" effort="10"/></joint>
  <link name="l3"/>
  <joint name="a4" type="revolute"><origin xyz="0.3 0 0" rpy="0 1.5 0"/><parent link="l3"/><child link="l4"/>
    <axis xyz="0 0.6 0.8"/><limit lower="-2" upper="2" velocity="2" effort="10"/></joint>
  <link name="l4"/>%s
</robot>
"""
FLANGE = """
  <joint name="f" type="fixed"><origin xyz="0.07 0 0"/><parent link="l4"/><child link="flange"/></joint>
  <link name="flange"/>
  <joint name="t" type="fixed"><origin rpy="0 1 0"/><parent link="flange"/><child link="tool0"/></joint>
  <link name="tool0"/>"""
MOVING = ("a 1", "a2", "a3", "a4")


def from_urdf(folder, tail, base, flange, rng):
    """A URDF on disk, and a calibration of the robot that it describes."""
    path = folder / "arm.urdf"
    path.write_text(URDF % tail)
    return path, wrong(cell_of(read_urdf(path, base, flange)), rng)


CHAINS = {
    "with a flange": (FLANGE, "base_link", "tool0"),
    "from the world": (FLANGE, "world", "flange"),
    "from a link beside": (
        FLANGE + '<link name="side"/><joint name="s" type="fixed"><origin xyz="1 0 0"/>'
        '<parent link="world"/><child link="side"/></joint>',
        "side",
        "tool0",
    ),
    "to the last moving link": ("", "base_link", "l4"),
}


@pytest.mark.parametrize("case", CHAINS)
def test_an_existing_urdf_moves_as_the_identified_robot(case, tmp_path, rng):
    tail, base, flange = CHAINS[case]
    path, calibration = from_urdf(tmp_path, tail, base, flange, rng)

    result = export(calibration, "urdf", Original(path, base, flange))

    text = result.files[".urdf"]
    assert result.deviation.max_mm < MICRO
    assert_same(
        lambda q: urdf_forward(text, "touchcal_jig", "touchcal_tip", dict(zip(MOVING, q, strict=True))),
        calibration,
        rng,
    )


def test_its_flange_is_where_the_identified_flange_is(tmp_path, rng):
    path, calibration = from_urdf(tmp_path, FLANGE, "base_link", "tool0", rng)
    without = calibration.theta.copy()
    without[:6], without[-6:] = 0.0, 0.0

    text = export(calibration, "urdf", Original(path, "base_link", "tool0")).files[".urdf"]

    for q in draws(calibration.cell.robot, rng, 5):
        T = urdf_forward(text, "base_link", "tool0", dict(zip(MOVING, q, strict=True)))
        assert np.abs(T - forward(calibration.cell.robot, q, without)).max() < MICRO


def test_everything_but_origins_of_the_chain_is_kept(tmp_path, rng):
    path, calibration = from_urdf(tmp_path, FLANGE, "base_link", "tool0", rng)

    text = export(calibration, "urdf", Original(path, "base_link", "tool0")).files[".urdf"]

    def skeleton(whole):
        added = re.compile(
            r'  <link name="touchcal_(\w+)"/>\n  <joint name="touchcal_\1_joint".*?</joint>\n', re.DOTALL
        )
        return re.sub(r"""(<origin\b[^>]*)/>""", "", added.sub("", whole))

    kept = ['<origin xyz="9 9 9"/> in a comment', '<origin xyz="0 0 1"/></joint>', '<origin rpy="0 1 0"/>']
    kept += ['<origin xyz="0 0 0.1" rpy="0 0 0"/>', '<origin xyz="0 0.02 0.1" rpy="0.1 0 0.2"/>']
    assert skeleton(text) == skeleton(path.read_text())
    assert all(part in text for part in kept)
    assert re.search(r'<joint name="a2" type="revolute"><origin xyz="[^"]+" rpy="[^"]+"/><parent', text)  # it had none


def test_a_robot_as_nominal_keeps_every_byte_and_gets_two_links(tmp_path, rng):
    path, calibration = from_urdf(tmp_path, FLANGE, "base_link", "tool0", rng)
    as_drawn = identified(calibration.cell, calibration.cell.theta)

    text = export(as_drawn, "urdf", Original(path, "base_link", "tool0")).files[".urdf"]

    head, tail = path.read_text().split("</robot>")
    assert text.startswith(head)
    assert text.endswith("</robot>" + tail)


def test_the_ends_of_the_chain_are_remembered_from_the_cell(tmp_path, rng):
    _, calibration = from_urdf(tmp_path, FLANGE, "base_link", "tool0", rng)

    assert ends_of(calibration) == ("base_link", "tool0")
    assert ends_of(wrong(cell_of(read_robot(library("robots")["irb120"])), rng)) is None


def test_another_urdf_than_that_of_the_cell_is_refused(tmp_path, rng):
    path, calibration = from_urdf(tmp_path, FLANGE, "base_link", "tool0", rng)
    path.write_text(path.read_text().replace("0.29", "0.30"))

    with pytest.raises(InputError, match="its flange is up to 10 mm from that of robot 'arm' in the calibration"):
        export(calibration, "urdf", Original(path, "base_link", "tool0"))


stage = st.tuples(*(st.floats(-0.5, 0.5) for _ in range(6)), st.sampled_from([0, 1, 2, 3]))


@given(st.lists(stage, min_size=2, max_size=6), st.integers(0, 2**31))
@settings(max_examples=25)
def test_any_chain_of_a_urdf_is_corrected(tmp_path_factory, stages, seed):
    rng, folder = np.random.default_rng(seed), tmp_path_factory.mktemp("chain")
    kinds = ["fixed", "revolute", "prismatic", "continuous"]
    if not any(stage[6] for stage in stages):
        stages = [(*stages[0][:6], 1), *stages[1:]]
    parts = []
    for i, (*values, kind) in enumerate(stages):
        axis = rng.standard_normal(3)
        origin = " ".join(map(repr, values[:3])), " ".join(map(repr, values[3:]))
        parts.append(
            f'<joint name="j{i}" type="{kinds[kind]}"><origin xyz="{origin[0]}" rpy="{origin[1]}"/>'
            f'<parent link="L{i}"/><child link="L{i + 1}"/><axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>'
            f'<limit lower="-1" upper="1" velocity="1" effort="1"/></joint><link name="L{i + 1}"/>'
        )
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm"><link name="L0"/>{"".join(parts)}</robot>')
    end = f"L{len(stages)}"
    calibration = wrong(cell_of(read_urdf(path, "L0", end)), rng)
    names = [f"j{i}" for i, stage in enumerate(stages) if stage[6]]

    text = export(calibration, "urdf", Original(path, "L0", end)).files[".urdf"]

    assert_same(
        lambda q: urdf_forward(text, "touchcal_jig", "touchcal_tip", dict(zip(names, q, strict=True))), calibration, rng
    )


def urdf_unit(robot):
    """What one unit of a URDF's joint value is here: a radian, or a metre."""
    return np.where(robot.prismatic, 1000, 1)


@pytest.mark.parametrize("name", ROBOTS)
def test_an_independent_library_reads_the_urdf_as_the_identified_robot(name, tmp_path, rng):
    robot = read_robot(library("robots")[name])
    calibration = wrong(cell_of(robot), rng)
    (tmp_path / "arm.urdf").write_text(export(calibration, "urdf").files[".urdf"])
    model = yourdfpy.URDF.load(tmp_path / "arm.urdf", load_meshes=False, build_collision_scene_graph=False)

    def found(q):
        model.update_cfg(dict(zip((joint.name for joint in robot.joints), q / urdf_unit(robot), strict=True)))
        T = model.get_transform("touchcal_tip", "touchcal_jig").copy()
        T[:3, 3] *= 1000
        return T

    assert_same(found, calibration, rng)


def yaml_forward(text, q):
    """base_T_flange [mm] of six origins with turns about z between them: a reader of its own."""
    entries = YAML(typ="safe").load(text)["kinematics"]
    T = np.eye(4)
    for name, value in zip(("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"), q, strict=True):
        e, step = entries[name], np.eye(4)
        step[:3, :3] = Rotation.from_euler("xyz", [e["roll"], e["pitch"], e["yaw"]]).as_matrix()
        step[:3, :3] = step[:3, :3] @ Rotation.from_euler("z", value).as_matrix()
        step[:3, 3] = np.array([e["x"], e["y"], e["z"]]) * 1000
        T = T @ step
    return T


def test_a_ur_file_moves_as_the_identified_robot(arc_welder, rng):
    calibration = identified(arc_welder, table_2(arc_welder))

    result = export(calibration, "ur-yaml")

    base, tool = transform(calibration.theta[:6]), transform(calibration.theta[-6:])
    assert re.search(r"\n  hash: calib_\d+\n$", result.files[".yaml"])
    assert result.deviation.max_mm < MICRO
    assert_same(lambda q: base @ yaml_forward(result.files[".yaml"], q) @ tool, calibration, rng)


def test_a_ur_file_says_what_it_has_no_room_for(arc_welder, rng):
    calibration = wrong(arc_welder, rng)

    result = export(calibration, "ur-yaml")

    assert result.deviation.max_mm > 0.1
    assert "behind the last joint: put it in the tool" in result.notes[0]


def test_the_hash_of_a_ur_file_is_that_of_its_numbers(arc_welder):
    hashes = {
        export(identified(arc_welder, theta), "ur-yaml").files[".yaml"].split("calib_")[1]
        for theta in (arc_welder.theta, arc_welder.theta.copy(), table_2(arc_welder))
    }

    assert len(hashes) == 2


@pytest.mark.parametrize("name", ["arm7", "scara"])
def test_a_ur_file_of_another_build_is_refused(name, rng):
    with pytest.raises(InputError, match="ur-yaml is for six turning joints"):
        export(wrong(cell_of(read_robot(library("robots")[name])), rng), "ur-yaml")


def dh_forward(files, q):
    """Rz(theta) Tz(d) Tx(a) Rx(alpha), one after the other, between the two frames: a reader of its own."""
    frames = {}
    for row in csv.DictReader(files["_frames.csv"].splitlines()):
        frames[row["frame"]] = transform(
            np.array(
                [
                    *(float(row[f"{k}_mm"]) for k in "xyz"),
                    *(np.radians(float(row[f"{k}_deg"])) for k in ("rz", "ry", "rx")),
                ]
            )
        )
    T = frames["jig_to_first"]
    for row, value in zip(csv.DictReader(files[".csv"].splitlines()), q, strict=True):
        theta, d = np.radians(float(row["theta_deg"])), float(row["d_mm"])
        theta, d = (theta, d + value) if row["type"] == "prismatic" else (theta + value, d)
        step = np.eye(4)
        step[:3, :3] = Rotation.from_euler("ZX", [theta, np.radians(float(row["alpha_deg"]))]).as_matrix()
        step[:3, 3] = [float(row["a_mm"]) * np.cos(theta), float(row["a_mm"]) * np.sin(theta), d]
        T = T @ step
    return T @ frames["last_to_tip"]


@pytest.mark.parametrize("name", ["arc-welder", "irb120", "scara"])
def test_a_table_of_four_parameters_moves_as_far_off_as_it_says(name, rng):
    calibration = wrong(cell_of(read_robot(library("robots")[name])), rng)
    robot = calibration.cell.robot

    result = export(calibration, "dh-csv")

    apart = [dh_forward(result.files, q) - forward(robot, q, calibration.theta) for q in draws(robot, rng, 100)]
    off = [np.linalg.norm(T[:3, 3]) for T in apart]
    assert max(off) < 1.5 * result.deviation.max_mm + MICRO
    assert np.median(off) > 0.2 * result.deviation.mean_mm - MICRO


def test_axes_that_stay_parallel_cost_nothing_and_have_no_lengths_that_run_away(arc_welder, rng):
    theta = arc_welder.theta.copy()
    theta[arc_welder.robot.parameters.index("j2.a")] += 1.0

    result = export(identified(arc_welder, theta), "dh-csv")

    assert result.notes == ()
    assert result.deviation.max_mm < MICRO


def test_axes_a_hundred_thousandth_of_a_degree_off_parallel_end_in_numbers_all_the_same(arc_welder):
    theta = arc_welder.theta.copy()
    theta[arc_welder.robot.parameters.index("j2.beta")] = np.radians(0.1)
    theta[arc_welder.robot.parameters.index("j2.alpha")] = np.radians(1e-5)

    result = export(identified(arc_welder, theta), "dh-csv")

    table = [[float(cell) for cell in row.split(",")[2:]] for row in result.files[".csv"].splitlines()[1:]]
    assert np.isfinite(table).all()
    assert np.abs(table).max() < 1000
    assert 0.1 < result.deviation.max_mm < 3.0  # what the fifth parameter would have carried


def test_four_parameters_are_copied_where_there_is_no_fifth(arc_welder):
    files = export(identified(arc_welder, arc_welder.theta), "dh-csv").files

    assert files[".csv"].splitlines()[2] == "j2,revolute,-90.0,0.0,350.0,0.0"


@pytest.mark.parametrize("name", ROBOTS)
def test_json_holds_everything(name, rng):
    result = export(wrong(cell_of(read_robot(library("robots")[name])), rng), "json")

    assert result.deviation.max_mm < MICRO
    assert result.deviation.max_deg < 1e-9


def test_zeros_and_frames_alone_suffice_where_nothing_else_is_wrong(arc_welder):
    names, theta = arc_welder.robot.parameters, arc_welder.theta.copy()
    for name, value in {"j2.theta": 0.02, "j3.theta": -0.01, "j5.theta": 0.015, "tool.x": 3.0, "base.z": -5.0}.items():
        theta[names.index(name)] += value

    result = export(identified(arc_welder, theta), "mastering-text")

    text = result.files[".txt"]
    assert result.deviation.max_mm < 1e-3  # six decimals of a degree
    assert float(re.search(r"j2 +(\S+) deg", text)[1]) == pytest.approx(np.degrees(0.02), abs=1e-5)
    assert float(re.search(r"j2 +\S+ deg +(\S+) deg", text)[1]) == pytest.approx(-np.degrees(0.02), abs=1e-5)
    assert re.search(r"j1 +0.000000 deg +0.000000 deg   carried by base or tool", text)
    assert re.search(r"j6 .* carried by base or tool", text)


def test_zeros_and_frames_leave_less_than_nothing_done(arc_welder):
    calibration = identified(arc_welder, table_2(arc_welder))

    text = export(calibration, "mastering-text").files[".txt"]

    nothing, done = (float(re.search(rf"{word}.* (\S+) / \S+ mm", text)[1]) for word in ("nothing done", "these zeros"))
    assert done < 0.5 * nothing


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_reads_back_what_it_writes_of_a_robot_as_drawn(name, arc_welder):
    result = export(identified(arc_welder, arc_welder.theta), name)

    assert result.deviation.max_mm < 1e-3
    assert all(text.endswith("\n") for text in result.files.values())


def test_a_format_that_is_not_known_is_refused_by_name(arc_welder):
    with pytest.raises(InputError, match="format 'sdf' is not known; choose one of urdf, ur-yaml"):
        export(identified(arc_welder, arc_welder.theta), "sdf")


@pytest.fixture
def bending(rng):
    """A calibration of a robot that bends and turns unevenly."""
    cell = cell_of(read_robot(library("robots")["irb120"]))
    cell = replace(cell, robot=replace(cell.robot, errors=("harmonics", "compliance")))
    theta = cell.theta.copy()
    theta[11] += np.radians(0.3)  # of joint 2: weights hang where the drawing has them
    theta[36:-6] = 0.5 * cell.scale[36:-6] * rng.standard_normal(len(theta) - 42)
    return identified(cell, theta)


def test_joint_errors_travel_in_json(bending):
    assert export(bending, "json").deviation.max_mm < MICRO


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "json"])
def test_a_format_that_holds_geometry_only_says_what_that_costs(name, bending, rng):
    made = export(bending, name)

    assert "without harmonics, compliance" in made.notes[0]
    assert f"{made.deviation.mean_mm:.3f} mm" in made.notes[0]
    nothing = bending.theta.copy()
    nothing[bending.cell.robot.parameters.index("j1.cos1") : -6] = 0.0
    q = draws(bending.cell.robot, rng, 200)
    tip = bending.cell.kinematics.tip
    left_out = np.linalg.norm(tip(q, bending.theta)[0] - tip(q, nothing)[0], axis=1).mean()
    assert 0.01 < made.deviation.mean_mm < left_out or name == "mastering-text"  # links carry some of it
