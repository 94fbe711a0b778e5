"""Every format reads back as the identified robot, by readers that share no line with what wrote it."""

import numpy as np
import pytest
from exported import FLANGE, cell_of, draws, from_urdf, wrong
from identified import identified

from identify.export.exporting import FORMATS, ends_of, export
from identify.model.files import InputError
from identify.model.io.description import library, read_robot


def test_the_ends_of_the_chain_are_remembered_from_the_cell(tmp_path, rng):
    _, calibration = from_urdf(tmp_path, FLANGE, "base_link", "tool0", rng)

    assert ends_of(calibration) == ("base_link", "tool0")
    assert ends_of(wrong(cell_of(read_robot(library("robots")["irb120"])), rng)) is None


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_reads_back_what_it_writes_of_a_robot_as_drawn(name, arc_welder):
    result = export(identified(arc_welder, arc_welder.theta), name)

    assert result.deviation.max_mm < 1e-3
    assert all(text.endswith("\n") for text in result.files.values())


def test_a_format_that_is_not_known_is_refused_by_name(arc_welder):
    with pytest.raises(InputError, match="format 'sdf' is not known; choose one of urdf, ur-yaml"):
        export(identified(arc_welder, arc_welder.theta), "sdf")


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
