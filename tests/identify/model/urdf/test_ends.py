"""Base and flange of published arms, found by geometry; what is no URDF is answered with a cure."""

from pathlib import Path

import numpy as np
import pytest

from identify.model.files import InputError
from identify.model.urdf.ends import ends, urdf_file

DATA = Path(__file__).parents[5] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the published arms are not here")

ARM = """<robot name="arm">
  <joint name="j1" type="revolute"><parent link="base_link"/><child link="l1"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1"/></joint>
  <joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.1 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="1"/></joint>
  <joint name="j3" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0.5 0 0"/>
    <axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="1"/></joint>
  <joint name="a" type="fixed"><parent link="l3"/><child link="plate"/><origin xyz="0.1 0 0"/></joint>
  {more}
</robot>"""


def written(tmp_path, text):
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("name", "base", "flange"),
    [
        ("robots/fanuc_m10ia_support", "base", "tool0"),
        ("robots/kuka_kr5_support", "base", "tool0"),
        ("mukca/panda.urdf", "panda_link0", "panda_link8"),
    ],
)
def test_the_flange_of_a_published_arm_looks_out_of_the_wrist(name, base, flange):
    found = ends(urdf_file(DATA / name))

    assert (found.base, found.flange) == (base, flange)
    np.testing.assert_allclose(found.outward, [0, 0, 1], atol=1e-9)


def test_the_flange_of_ros_industrial_looks_along_its_x_axis_when_it_is_named():
    found = ends(urdf_file(DATA / "robots/fanuc_m10ia_support"), flange="flange")

    np.testing.assert_allclose(found.outward, [1, 0, 0], atol=1e-9)


@pytest.mark.parametrize("sign", [1, -1])
def test_outward_is_away_from_the_wrist_whatever_the_sense_of_the_axis(tmp_path, sign):
    found = ends(written(tmp_path, ARM.format(axis=f"{sign} 0 0", more="")))

    assert found.base == "base_link"
    np.testing.assert_allclose(found.outward, [1, 0, 0], atol=1e-9)
    assert found.flange == "plate"  # not l3, which the last joint moves: the plate lies 100 mm behind it
    assert found.why.startswith("no frame behind the last joint has its z axis out of the wrist")


@pytest.mark.parametrize("turns", [1, -1])
def test_the_spindle_of_a_scara_hangs_down_whatever_the_sense_of_its_axis(tmp_path, turns):
    joints = [("s1", "revolute", "0 0 0.4", 1), ("s2", "revolute", "0.35 0 0", 1), ("z", "prismatic", "0.3 0 0", -1)]
    text = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="0 0 {sense}"/><limit lower="0" upper="0.3" velocity="1"/></joint>'
        for k, (name, kind, xyz, sense) in enumerate([*joints, ("s4", "revolute", "0 0 0", turns)])
    )

    found = ends(written(tmp_path, f'<robot name="scara">{text}</robot>'))

    assert found.flange == "l4"
    np.testing.assert_allclose(found.outward, [0, 0, -1], atol=1e-9)


def test_fingers_are_no_arm(tmp_path):
    fingers = "".join(
        f'<joint name="f{i}" type="prismatic"><parent link="plate"/><child link="finger{i}"/>'
        '<axis xyz="0 1 0"/><limit lower="0" upper="0.04" velocity="1"/></joint>'
        for i in (1, 2)
    )

    assert ends(written(tmp_path, ARM.format(axis="1 0 0", more=fingers))).flange in ("l3", "plate")


@pytest.mark.parametrize("follows", ["", '<mimic joint="gripper"/>'])
def test_a_hand_that_turns_is_no_part_of_the_arm(follows, tmp_path):
    jaw = f"""<joint name="gripper" type="revolute"><parent link="plate"/><child link="jaw"/><origin xyz="0.05 0 0"/>
      <axis xyz="0 1 0"/><limit lower="0" upper="1" velocity="1"/></joint>
      <joint name="tip" type="revolute"><parent link="jaw"/><child link="end"/><origin xyz="0.05 0 0"/>
      <axis xyz="0 1 0"/><limit lower="0" upper="1" velocity="1"/>{follows}</joint>"""

    arm = ends(written(tmp_path, ARM.format(axis="1 0 0", more=jaw)))

    assert arm.flange == "plate"
    assert arm.outward == pytest.approx([1, 0, 0])


@pytest.mark.parametrize("text", ['<robot name="a"/>', '<robot name="a"><link name="plate"/></robot>'])
def test_a_file_without_joints_is_asked_about(text, tmp_path):
    with pytest.raises(InputError, match="no joint moves; is this the URDF of an arm"):
        ends(written(tmp_path, text))


def test_what_xacro_leaves_in_a_file_that_it_expanded_is_no_xacro(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(
        '<!-- <xacro:arm prefix="${prefix}"/> -->\n<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a"/>'
    )

    assert urdf_file(path) == path


def test_a_xacro_is_answered_with_the_command_that_expands_it(tmp_path):
    (tmp_path / "urdf").mkdir()
    path = tmp_path / "urdf" / "arm.urdf.xacro"
    path.write_text('<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="${prefix}arm"/>')

    for asked in (path, tmp_path):
        with pytest.raises(InputError, match=r"expand it first: xacro .*arm.urdf.xacro > arm.urdf"):
            urdf_file(asked)


def test_a_folder_with_several_urdfs_names_them(tmp_path):
    for name in "ab":
        (tmp_path / f"{name}.urdf").write_text("<robot/>")

    with pytest.raises(InputError, match=r"holds 2 URDFs; name one of .*a\.urdf, .*b\.urdf"):
        urdf_file(tmp_path)
