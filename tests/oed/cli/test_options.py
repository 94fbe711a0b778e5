"""What commands print: tables that fit the screen."""

from pathlib import Path

import pytest

from identify.model.files import InputError
from identify.model.io.calibration_file import Errors
from oed.cli.options import errors_table, own_criterion

ROWS = {"identified robot, unseen": Errors(120, 0.1, 0.2, 0.3, 0.4), "regions held out": None}


@pytest.mark.parametrize("columns", [60, 80])
def test_a_table_of_errors_keeps_to_the_screen(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))

    lines = errors_table(ROWS).splitlines()

    assert max(map(len, lines)) <= columns
    assert [line.split()[-1] for line in lines if "120" in line] == ["0.400"]
    assert any("none could be spared" in line for line in lines)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("K = 1 / 0", "own.py: ZeroDivisionError: division by zero"),
        ("K = 3", "own.py: K is a int, expected a criterion"),
        ("", "own.py: K is nothing, expected a criterion"),
        (None, "own.py: no such file"),
    ],
)
def test_a_criterion_that_a_file_does_not_define_is_refused(text, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if text is not None:
        (tmp_path / "own.py").write_text(text)

    with pytest.raises(InputError, match=says):
        own_criterion("own.py:K")


def test_a_criterion_of_a_file_is_planned_by_its_name(monkeypatch):
    from oed.criteria.criteria import CRITERIA

    monkeypatch.setattr("oed.criteria.criteria.CRITERIA", dict(CRITERIA))
    example = Path(__file__).parents[3] / "studies" / "examples" / "own_criterion.py"

    assert own_criterion(f"{example}:K2") == "K2"
    assert own_criterion("V") == "V"
    from oed.criteria import criteria

    assert criteria.CRITERIA["K2"].source == "Kiefer 1974"
