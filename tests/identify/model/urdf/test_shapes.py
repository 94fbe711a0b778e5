"""Collision shapes of a URDF: meshes as three formats write them, where the file is, and where they stand."""

import numpy as np
import pytest
from meshed import LINKS, arm, box, collision, mesh, stl, written
from scipy.spatial.transform import Rotation

from identify.model.files import InputError
from identify.model.kinematics import Kinematics
from identify.model.urdf.chain import read_urdf


def semantics(q):
    """Frames of the links of the arm by the specification of URDF [mm]."""
    T, out = np.eye(4), {"base_link": np.eye(4)}
    for (name, joint, _, _), value in zip(LINKS[1:], q, strict=True):
        origin, axis = joint
        step = np.eye(4)
        step[:3, 3] = 1000 * np.array(origin)
        step[:3, :3] = Rotation.from_rotvec(value * np.array([float(x) for x in axis.split()])).as_matrix()
        T = T @ step
        out[name] = T
    out["flange"] = T @ np.block(
        [[Rotation.from_euler("y", 1.5707963).as_matrix(), np.zeros((3, 1))], [np.zeros(3), 1]]
    )
    return out


def test_shapes_stand_on_the_moving_robot_where_the_urdf_says(tmp_path, rng):
    turned = '<origin xyz="0.1 -0.2 0.3" rpy="0.4 0.5 0.6"/>'
    solids = {
        "upper": collision('<box size="0.1 0.2 0.3"/>', turned),
        "fore": collision('<cylinder radius="0.05" length="0.4"/>', turned),
        "flange": collision('<sphere radius="0.07"/>', turned),
    }
    robot = read_urdf(written(tmp_path, **solids), "base_link", "flange")
    kinematics, theta = Kinematics(robot), robot.theta(np.zeros(6), np.zeros(6))
    placed = np.eye(4)
    placed[:3, :3] = Rotation.from_euler("xyz", [0.4, 0.5, 0.6]).as_matrix()
    placed[:3, 3] = 100, -200, 300

    for q in rng.uniform(robot.lower, robot.upper, (5, 6)):
        frames, expected = kinematics.links(q[None], theta), semantics(q)

        for shape in robot.shapes:
            T = np.vstack([frames[shape.link][0], [0, 0, 0, 1]])
            local = placed if shape.name in solids else np.eye(4)
            assert T @ shape.pose == pytest.approx(expected[shape.name] @ local, abs=1e-7)
    assert {s.name: s.link for s in robot.shapes}["flange"] == 6
    assert {s.kind: s.size for s in robot.shapes if s.kind != "mesh"} == {
        "box": (100, 200, 300),
        "cylinder": (50, 400),
        "sphere": (70,),
    }


def test_what_is_fixed_to_a_link_moves_with_it_and_what_moves_besides_is_left_out(tmp_path):
    text = arm({}).replace(
        "</robot>",
        f'<link name="cable">{collision(mesh("any.stl"))}</link><link name="finger">{collision(mesh("any.stl"))}</link>'
        f'<link name="floor">{collision(mesh("any.stl"))}</link>'
        '<joint name="c" type="fixed"><parent link="elbow"/><child link="cable"/><origin xyz="0 0 1"/></joint>'
        '<joint name="f" type="prismatic"><parent link="flange"/><child link="finger"/><axis xyz="0 0 1"/></joint>'
        '<joint name="g" type="fixed"><parent link="floor"/><child link="base_link"/><origin xyz="0 0 2"/></joint>'
        "</robot>",
    )
    (tmp_path / "arm.urdf").write_text(text)

    robot = read_urdf(tmp_path / "arm.urdf", "base_link", "flange")

    assert [(s.name, s.link) for s in robot.shapes] == [("floor", 0), ("cable", 3)]
    assert robot.shapes[0].pose[2, 3] == pytest.approx(-2000)


@pytest.mark.parametrize(
    "file", ["part.stl", "package://arm/part.stl", "package://any/arm/part.stl", "file://{folder}/arm/part.stl"]
)
def test_a_mesh_is_found_beside_the_urdf_in_its_package_or_where_it_is(tmp_path, file):
    (tmp_path / "any" / "arm").mkdir(parents=True)
    home = tmp_path / "any" / "arm"
    (home / "part.stl").write_bytes(stl(*box((1, 1, 1))))
    text = arm({"upper": collision(mesh(file.format(folder=tmp_path / "any"), "0.002 0.002 -0.002"))})
    (home / "arm.urdf").write_text(text)

    (shape,) = read_urdf(home / "arm.urdf", "base_link", "flange").shapes

    assert shape.path is not None
    assert shape.mesh[0].max(axis=0) - shape.mesh[0].min(axis=0) == pytest.approx([2, 2, 2])  # [mm]


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        ('<box size="1 2"/>', "arm.urdf:.*collision of link 'upper': size is '1 2', expected 3 numbers"),
        ('<sphere radius="-1"/>', "collision of link 'upper': a sphere of size 0 or less"),
        ("", "collision of link 'upper' has no geometry"),
    ],
)
def test_a_shape_that_makes_no_sense_is_told_with_its_line(tmp_path, geometry, message):
    (tmp_path / "arm.urdf").write_text(arm({"upper": collision(geometry)}))

    with pytest.raises(InputError, match=message):
        read_urdf(tmp_path / "arm.urdf", "base_link", "flange")
