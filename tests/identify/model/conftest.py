"""Files of a cell and tables beside it."""

import pytest
from cell_texts import CELL, JIG, ROBOT
from counts import cell_text

from identify.model.io.description import read_cell


@pytest.fixture
def write(tmp_path):
    def write(content, name="file.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture
def write_cell(tmp_path):
    """Writes the three files of a cell, each as given, and returns the path of cell.yaml."""

    def write_cell(cell=CELL, robot=ROBOT, jig=JIG):
        for name, text in (("cell", cell), ("robot", robot), ("jig", jig)):
            (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
        return tmp_path / "cell.yaml"

    return write_cell


@pytest.fixture
def counted(tmp_path):
    """The arc-welder whose controller counts as ODD says."""
    path = tmp_path / "cell.yaml"
    path.write_text(
        cell_text(
            "joints:",
            "  sign: {j2: -1, j5: -1}",
            "  zero_deg: [0, 90, 0, -12.5, 0, 180]",
            "  coupled: {j3: j2, j5: -j4}",
            "  pulses_per_deg: [100, 100, 100, 100, 100, 100]",
        )
    )
    return read_cell(path)


@pytest.fixture
def q(arc_welder, rng):
    return rng.uniform(arc_welder.robot.lower, arc_welder.robot.upper, (6, 6))
