"""The arm in the 3-D view: meshes stay small and in place."""

from base64 import b64decode
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshed import box, stl

from identify.model.shape import Shape
from identify.report.scene import TRIANGLES, UNIT, scene, simplified


def ball(n):
    """A sphere of radius 100 mm with about 2 n^2 triangles."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, n), np.linspace(0.01, np.pi - 0.01, n))
    vertices = 100 * np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1).reshape(-1, 3)
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = (x.ravel() for x in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def test_a_large_mesh_is_merged_and_keeps_its_shape():
    vertices, triangles = simplified(*ball(200))

    assert 200 < len(triangles) <= TRIANGLES
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 100, atol=1e-6)
    assert triangles.max() < len(vertices)


def test_a_small_mesh_stays_as_it_is():
    vertices, triangles = simplified(*box((40.0, 60.0, 80.0)))

    assert len(vertices) == 8
    assert len(triangles) == 12


@pytest.fixture
def meshed(arc_welder, tmp_path):
    path = Path(tmp_path, "link.stl")
    path.write_bytes(stl(*box((0.04, 0.06, 0.08))))
    shape = Shape(2, "upper", "mesh", (1000.0,) * 3, np.eye(4), "link.stl", path)
    return replace(arc_welder, robot=replace(arc_welder.robot, shapes=(shape,)))


def test_a_link_stands_in_the_scene_where_the_kinematics_has_it(meshed, rng):
    q = rng.uniform(meshed.robot.lower, meshed.robot.upper, (3, 6))

    shown = scene(meshed, None, ("a", "b", "c"), ("", "", ""), q, ("", "", ""))

    (link,) = shown["links"]
    corners = np.frombuffer(b64decode(link["vertices"]), "<i2").reshape(-1, 3) * UNIT
    T = meshed.kinematics.links(q, meshed.theta)[2]
    for row, touch in zip(T, shown["touches"], strict=True):
        x, y, z, *quaternion = touch["frames"][7 * 2 : 7 * 2 + 7]
        a, b, c, w = quaternion
        turned = corners + 2 * np.cross([a, b, c], np.cross([a, b, c], corners) + w * corners)
        np.testing.assert_allclose(turned + np.array([x, y, z]), corners @ row[:, :3].T + row[:, 3], atol=0.1)


def test_the_torch_bends_at_its_neck_towards_the_flange(arc_welder, rng):
    q = rng.uniform(arc_welder.robot.lower, arc_welder.robot.upper, (3, 6))

    shown = scene(arc_welder, None, ("a", "b", "c"), (None,) * 3, q, ("", "", ""))

    tip, R = arc_welder.kinematics.tip(q, arc_welder.theta)
    for p, wire, touch in zip(tip, R[:, :, 2], shown["touches"], strict=True):
        np.testing.assert_allclose(touch["nominal"][-2:], [p - 110 * wire, p], atol=0.1)


def test_obstacles_stand_where_they_lean(arc_welder, tmp_path):
    pose = np.array([[0.6, 0, 0.8, 50], [0, 1, 0, 60], [-0.8, 0, 0.6, 70], [0, 0, 0, 1]])
    part = tmp_path / "part.stl"
    part.write_bytes(stl(*box((40.0, 60.0, 80.0))))
    shapes = (
        Shape(0, "ramp", "box", (80.0, 200.0, 40.0), pose),
        Shape(0, "part", "mesh", (1.0,), pose, part.name, part),
    )

    ramp, mesh = scene(replace(arc_welder, obstacles=shapes), None, (), (), np.empty((0, 6)), ())["shapes"]

    np.testing.assert_allclose(ramp["pose"], pose.ravel())
    assert ramp["size"] == [80.0, 200.0, 40.0]
    corners = np.frombuffer(b64decode(mesh["vertices"]), "<i2").reshape(-1, 3) * UNIT
    known = box((40.0, 60.0, 80.0))[0] @ pose[:3, :3].T + pose[:3, 3]
    assert all(np.linalg.norm(corners - corner, axis=1).min() < UNIT for corner in known)
