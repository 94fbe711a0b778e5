"""An arm of meshes."""

import numpy as np
import pytest
from boxed_arm import BASE, TOOL, ZONE
from meshed import written

from identify.model.cell import Cell
from identify.model.io.description import library, read_jig
from identify.model.urdf.chain import read_urdf
from oed.candidates.candidates import candidates


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    robot = read_urdf(written(tmp_path_factory.mktemp("arm")), "base_link", "flange")
    return Cell(robot, read_jig(library("jigs")["step-block"]), BASE, TOOL, zone=ZONE)


@pytest.fixture(scope="module")
def touches(arc_welder):
    found = candidates(arc_welder, np.random.default_rng(2), 400)
    return found.take(np.random.default_rng(3).choice(len(found), 16, replace=False))
