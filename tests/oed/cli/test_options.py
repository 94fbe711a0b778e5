"""What commands print: tables that fit the screen."""

import pytest

from identify.model.io.calibration_file import Errors
from oed.cli.options import errors_table

ROWS = {"identified robot, unseen": Errors(120, 0.1, 0.2, 0.3, 0.4), "regions held out": None}


@pytest.mark.parametrize("columns", [60, 80])
def test_a_table_of_errors_keeps_to_the_screen(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))

    lines = errors_table(ROWS).splitlines()

    assert max(map(len, lines)) <= columns
    assert [line.split()[-1] for line in lines if "120" in line] == ["0.400"]
    assert any("none could be spared" in line for line in lines)
