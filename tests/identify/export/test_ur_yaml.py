"""The kinematics of a UR arm read back as the identified robot."""

import re

import numpy as np
import pytest
from exported import MICRO, assert_same, cell_of, wrong
from identified import identified
from measured import table_2
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from identify.export.exporting import export
from identify.model.files import InputError
from identify.model.frames import transform
from identify.model.io.description import library, read_robot


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
