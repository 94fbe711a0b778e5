"""A base that is placed reaches the jig: judged by inverse kinematics from other starts, at points of its own."""

from pathlib import Path

import numpy as np
import pytest

from identify.model.base_placement import starting_cell
from identify.model.ik import reach
from identify.model.io.description import library, read_jig, read_robot
from identify.model.urdf.chain import read_urdf
from identify.model.urdf.ends import ends, urdf_file
from identify.model.zone import frames

DATA = Path(__file__).parents[4] / "shared" / "data" / "robots"
Z = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def irb120():
    robot, jig = read_robot(library("robots")["irb120"]), read_jig(library("jigs")["cube"])
    return starting_cell(robot, jig, Z)


def test_the_tops_of_the_jig_are_reached_from_where_the_base_is_placed(irb120):
    cell, _ = irb120
    rng = np.random.default_rng(9)
    tops = [face for face in cell.jig.faces if face.normal[2] > 0.9]
    point = np.concatenate([face.point(*rng.random((2, 20))) for face in tops])
    R = frames(np.tile(-Z, (len(point), 1)), 2 * np.pi * rng.random(len(point)))
    reached = np.zeros(len(point), dtype=bool)
    for _ in range(20):
        start = rng.uniform(cell.robot.lower, cell.robot.upper, (len(point), 6))
        reached |= reach(cell.kinematics, cell.theta, point, R, start, free_roll=True).reached()

    assert reached.mean() > 0.95


def test_the_same_robot_and_jig_give_the_same_cell(irb120):
    again, _ = starting_cell(irb120[0].robot, irb120[0].jig, Z)

    np.testing.assert_array_equal(again.base, irb120[0].base)


@pytest.mark.parametrize("outward", [[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0], [0.6, 0, 0.8]])
def test_the_torch_leaves_the_flange_outward(irb120, outward):
    cell, _ = starting_cell(irb120[0].robot, irb120[0].jig, np.array(outward))

    assert cell.tool[:3] @ outward == pytest.approx(np.linalg.norm(cell.tool[:3]))


@pytest.mark.skipif(not DATA.is_dir(), reason="the published arms are not here")
def test_a_published_arm_stands_on_the_table_of_the_jig():
    file = urdf_file(DATA / "fanuc_m10ia_support")
    found = ends(file)
    cell, _ = starting_cell(read_urdf(file, found.base, found.flange), read_jig(library("jigs")["step-block"]), Z)

    assert cell.base[2] >= 440  # the FANUC's base frame lies 450 mm above its foot
    assert [joint.name for joint in cell.robot.joints] == [f"joint_{i}" for i in range(1, 7)]
