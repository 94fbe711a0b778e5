"""The commented cell.yaml reads back as the cell that it was written from."""

from dataclasses import replace

import numpy as np
import pytest

from identify.model.io.description import library, read_cell
from identify.model.io.template import MEASURES, cell_text, measure_text


@pytest.fixture
def cell(arc_welder):
    """A cell none of whose numbers is what a cell has that says nothing."""
    return replace(
        arc_welder,
        base=np.array([12.5, -700.25, 33.0, 1.0, 0.2, -0.3]),
        touch=replace(arc_welder.touch, sigma=0.07, approach=20.0, speed=4.0),
        priors=replace(arc_welder.priors, base=(4.0, 0.01), link=(0.5, 0.001)),
    )


def written(cell, folder, more=""):
    path = folder / "cell.yaml"
    path.write_text(cell_text(cell, "library:arc-welder", "library:step-block", {"base": "by hand"}, "s.json") + more)
    return path


def test_the_text_of_a_cell_reads_back_as_the_cell(cell, tmp_path):
    again = read_cell(written(cell, tmp_path))

    np.testing.assert_allclose(again.theta, cell.theta, atol=1e-7)
    np.testing.assert_allclose(again.scale, cell.scale, rtol=1e-5)
    np.testing.assert_allclose(again.zone.box, cell.zone.box)
    assert again.touch == cell.touch
    assert "# by hand\nbase:" in (tmp_path / "cell.yaml").read_text()


@pytest.mark.parametrize("measure", MEASURES)
def test_every_device_is_described_by_a_text_that_is_a_valid_cell(measure, cell, tmp_path):
    again = read_cell(written(cell, tmp_path, measure_text(measure, cell)))

    low, high = cell.zone.box.T
    assert all(((low - 1 <= p.position) & (p.position <= high + 1)).all() for p in again.points.values())
    for spacing in again.spacings:  # as far apart as the points stand
        way = again.places[spacing.start] - again.places[spacing.end]
        assert spacing.distance == pytest.approx(np.linalg.norm(way), abs=1.0)


def test_the_lines_that_are_commented_out_are_valid_too(cell, tmp_path):
    path = written(cell, tmp_path)
    lines = path.read_text().splitlines()
    keys = ("# joints:", "# errors:")

    path.write_text("\n".join(line[2:] if line.startswith(keys) else line for line in lines))

    again = read_cell(path)
    assert again.robot.counting.differs
    assert again.robot.errors == ("harmonics", "compliance", "backlash")
    assert not read_cell(library("cells")["arc-welder"]).robot.errors
