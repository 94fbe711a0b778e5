"""A calibrated URDF moves as the identified robot, by readers that share no line with what wrote it."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
import yourdfpy
from exported import FLANGE, MICRO, ROBOTS, assert_same, cell_of, draws, from_urdf, wrong
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import forward
from scipy.spatial.transform import Rotation

from identify.export.exporting import export
from identify.export.formats import Original
from identify.model.files import InputError
from identify.model.io.description import library, read_robot
from identify.model.urdf.chain import read_urdf


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


MOVING = ("a 1", "a2", "a3", "a4")


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
