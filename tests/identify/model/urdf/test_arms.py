"""Arms by URDF as their users write them: chain, flange, and a place from which the jig is touched."""

import numpy as np
import pytest
from arms import ARMS

from identify.model.base_placement import starting_cell
from identify.model.cell import DEG
from identify.model.io.description import library, read_jig
from identify.model.urdf.chain import read_urdf
from identify.model.urdf.ends import ends
from oed.candidates.candidates import candidates

EXPECTED = {  # base, flange, joints
    "ur5": ("base_link", "tool0", "RRRRRR"),
    "ur10": ("base_link", "tool0", "RRRRRR"),
    "irb2400": ("base", "tool0", "RRRRRR"),
    "mh5": ("base_link", "tool0", "RRRRRR"),
    "panda": ("panda_link0", "panda_hand", "RRRRRRR"),
    "scara": ("base_link", "tool0", "RRPR"),
    "five": ("base_link", "tool0", "RRRRR"),
    "track": ("base_link", "tool0", "PRRRRRR"),
    "endless": ("base_link", "tool0", "RRRRRR"),
    "fingers": ("base_link", "tool0", "RRRRRR"),
    "spaces": ("The Base", "The Flange", "RRRRRR"),
}


def arm(name, folder):
    path = folder / f"{name}.urdf"
    path.write_text(ARMS[name])
    found = ends(path)
    return found, read_urdf(path, found.base, found.flange)


@pytest.mark.parametrize("name", ARMS)
def test_the_chain_of_an_arm_is_found_by_its_geometry(name, tmp_path):
    found, robot = arm(name, tmp_path)

    kinds = "".join("P" if joint.prismatic else "R" for joint in robot.joints)
    assert (found.base, found.flange, kinds) == EXPECTED[name]
    np.testing.assert_allclose(found.outward, [0, 0, 1], atol=1e-9)


@pytest.mark.parametrize("name", ["scara", "five"])
def test_every_face_of_the_jig_is_touched_from_where_the_arm_is_put(name, tmp_path):
    found, robot = arm(name, tmp_path)

    cell, notes = starting_cell(robot, read_jig(library("jigs")["cube"]), found.outward)

    assert (candidates(cell, np.random.default_rng(0), 100).number > 0).all()
    assert "walls and tops" in notes["tool"]
    assert cell.tool[4] == pytest.approx(-45 * DEG)
