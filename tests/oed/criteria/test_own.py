"""Criteria of one's own from Python files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from informations import ALL, OWN, drawn
from own_criterion import Compromise

from identify.model.files import InputError
from oed import approximate_design, exact_design
from oed.criteria.criteria import CRITERIA
from oed.criteria.own import OwnCriterion, check


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


@pytest.mark.parametrize("name", ALL)
def test_a_criterion_whose_slope_and_degree_belong_to_its_value_passes(name):
    criterion, *_ = drawn(name, 5)

    check(criterion, 4)


def test_a_wrong_degree_and_a_wrong_slope_of_an_own_criterion_are_named():
    class Steep(Compromise):
        def slope(self, M):
            return 2 * super().slope(M)

    rows = np.random.default_rng(6).normal(size=(30, 3))

    with pytest.raises(
        ValueError, match=r"own: twice the information makes the value 2 times as large, and by its degree, 2, 4 times"
    ):
        approximate_design(rows, replace(OWN, degree=2.0))
    with pytest.raises(ValueError, match=r"steep: `slope` is not the gradient"):
        exact_design(rows, 6, Steep("steep", 1.0, "rotation", "of these tests", OWN.parts))
