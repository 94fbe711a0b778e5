"""Every file that travels with touchcal is valid, and every jig is the solid that its boxes say."""

from itertools import combinations

import numpy as np
import pytest
from oracle import forward

from identify.model.io.description import library, read_cell, read_jig, read_robot

ROBOTS = {name: read_robot(path) for name, path in library("robots").items()}


JIGS = {name: read_jig(path) for name, path in library("jigs").items()}


NEAR = 1e-3  # [mm]


def test_the_library_holds_what_is_promised():
    assert set(ROBOTS) >= {"arc-welder", "irb120", "puma560"}
    assert set(JIGS) >= {"step-block", "cube"}
    assert sum(len(robot.joints) == 7 for robot in ROBOTS.values()) >= 1
    assert sum(any(robot.prismatic) and len(robot.joints) == 4 for robot in ROBOTS.values()) >= 1


@pytest.mark.parametrize("name", library("cells"))
def test_every_cell_is_valid_and_complete(name):
    cell = read_cell(library("cells")[name])

    assert cell.jig is not None
    assert cell.zone is not None
    assert cell.theta.size == 12 + 5 * len(cell.robot.joints)
    assert len(cell.sources) == 3  # the cell, the robot, the jig


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_is_called_as_its_file_and_says_where_it_comes_from(name):
    robot = ROBOTS[name]

    assert robot.name == name
    assert robot.source
    assert (robot.lower < robot.upper).all()
    assert (robot.speed > 0).all()


def test_the_arc_welder_is_that_of_table_1():
    table = np.array(
        [  # theta, d, a, alpha, beta
            [0, 0, 0, -90, 0],
            [-90, 0, 350, 0, 0],
            [0, 80, 0, -90, 0],
            [0, 350, 0, 90, 0],
            [0, -60, 0, -90, 0],
            [0, 0, 0, 0, 0],
        ]
    )

    links = np.array([joint.link for joint in ROBOTS["arc-welder"].joints])

    links[:, [0, 3, 4]] = np.degrees(links[:, [0, 3, 4]])
    np.testing.assert_allclose(links, table, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "flange"),
    [
        ("irb120", (374, 0, 630)),  # [mm] product specification: 302 + 72 forward, 290 + 270 + 70 up
        ("puma560", (452.1, -150.05, 431.8)),  # Corke, Robotics Toolbox, p560.fkine(qz)
        ("arm7", (0, 0, 1306)),  # stretched upwards, 360 + 420 + 400 + 126
        ("scara", (600, 0, 380)),  # stretched, quill up
    ],
)
def test_at_zero_a_robot_stands_as_its_drawing_shows_it(name, flange):
    robot = ROBOTS[name]

    T = forward(robot, np.zeros(len(robot.joints)), robot.theta(np.zeros(6), np.zeros(6)))

    np.testing.assert_allclose(T[:3, 3], flange, atol=1e-9)


@pytest.mark.parametrize("name", JIGS)
def test_the_faces_of_a_jig_point_along_all_axes(name):
    normals = np.array([face.normal for face in JIGS[name].faces])

    assert np.linalg.matrix_rank(normals) == 3
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)


def inside(jig, point):
    return any(np.all((point > box.lower) & (point < box.upper)) for box in jig.boxes)


@pytest.mark.parametrize("name", JIGS)
def test_the_faces_of_a_jig_lie_on_its_surface_and_point_outwards(name, rng):
    for face in JIGS[name].faces:
        s, t = rng.uniform(0.01, 0.99, (2, 50))
        for point in face.point(s, t):
            assert not inside(JIGS[name], point + NEAR * face.normal), f"{face.name} points into the block"
            assert inside(JIGS[name], point - NEAR * face.normal), f"{face.name} has nothing behind it"


@pytest.mark.parametrize("name", JIGS)
def test_the_faces_of_a_jig_do_not_overlap(name, rng):
    for one, other in combinations(JIGS[name].faces, 2):
        points = one.point(*rng.uniform(0.01, 0.99, (2, 200)))
        on_plane = np.abs(points @ other.normal - other.offset) < NEAR
        within = ((other.fractions(points) > 0) & (other.fractions(points) < 1)).all(axis=1)
        assert not (on_plane & within).any(), f"{one.name} and {other.name}"
