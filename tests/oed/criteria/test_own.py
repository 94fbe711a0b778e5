"""Criteria of one's own from Python files."""

from pathlib import Path

import pytest

from identify.model.files import InputError
from oed.criteria.criteria import CRITERIA
from oed.criteria.own import OwnCriterion


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("K = 1 / 0", "own.py: ZeroDivisionError: division by zero"),
        ("K = 3", "own.py: K is a int, expected a criterion"),
        ("from oed.criteria.criteria import CRITERIA; K = CRITERIA['V']", "name 'V' of K is taken"),
        ("", "own.py: K is nothing, expected a criterion"),
        (None, "own.py: no such file"),
    ],
)
def test_a_criterion_that_a_file_does_not_define_is_refused(text, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if text is not None:
        (tmp_path / "own.py").write_text(text)

    with pytest.raises(InputError, match=says):
        OwnCriterion.named("own.py:K").define()


def test_a_criterion_of_a_file_is_put_into_the_table_under_its_name(monkeypatch):
    table = dict(CRITERIA)
    monkeypatch.setattr("oed.criteria.own.CRITERIA", table)
    example = Path(__file__).parents[3] / "studies" / "examples" / "own_criterion.py"

    criterion = OwnCriterion.named(f"{example}:K2").define()

    assert table["K2"] is criterion
    assert criterion.source == "Kiefer 1974"
    assert OwnCriterion.named("V") is None
