"""plan-cell.yaml: the cell with a workpiece in the place of its jig, wherever the files lie."""

import numpy as np
import pytest

from identify.model.io.description import library, read_cell
from oed.cli.plans.workpiece import cell_text


@pytest.fixture
def original(tmp_path):
    """A cell whose robot, jig and workpiece lie in folders of their own."""
    for kind, name in (("robots", "arc-welder"), ("jigs", "step-block"), ("jigs", "cube")):
        (tmp_path / kind).mkdir(exist_ok=True)
        (tmp_path / kind / f"{name}.yaml").write_text(library(kind)[name].read_text())
    text = library("cells")["arc-welder"].read_text()
    text = text.replace("library:arc-welder", "../robots/arc-welder.yaml").replace(
        "library:step-block", "../jigs/step-block.yaml"
    )
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "cell.yaml").write_text("# kept\n" + text)
    return tmp_path / "cell" / "cell.yaml"


def test_paths_lead_from_where_the_file_will_lie(original, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cell, beside = read_cell(original), tmp_path / "out" / "deep" / "plan-cell.yaml"
    beside.parent.mkdir(parents=True)

    beside.write_text(cell_text(original, beside, "jigs/cube.yaml", cell))

    placed = read_cell(beside)
    assert placed.robot.name == cell.robot.name
    assert placed.jig.name == "cube"
    np.testing.assert_allclose(placed.base, cell.base, atol=1e-8)
    assert placed.zone is None  # that of the jig is none of the workpiece
    assert "# kept" in beside.read_text()


def test_what_is_of_the_library_stays_of_the_library(original, tmp_path):
    original.write_text(library("cells")["arc-welder"].read_text())

    text = cell_text(original, tmp_path / "plan-cell.yaml", "library:cube", read_cell(original))

    assert "robot: library:arc-welder" in text
    assert "jig: library:cube" in text
