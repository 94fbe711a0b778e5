"""Medians by strategy and number, counted by hand."""

from pathlib import Path

import numpy as np
import pytest

from identify.model.files import InputError
from oed.criteria.criteria import CRITERIA
from oed.criteria.own import OwnCriterion
from studies.engine import Study
from studies.strategies import medians

EXAMPLE = Path(__file__).parents[2] / "studies" / "examples" / "own_criterion.py"

TABLE = {
    "strategy": ["even", "even", "even", "V", "V"],
    "touches": [30, 30, 60, 30, 30],
    "rms_mm": [0.2, 0.4, 0.1, 0.3, 0.1],
}


def test_medians_stand_by_strategy_and_number():
    found = medians(TABLE)

    assert list(found) == ["even", "V"]
    assert {name: {n: round(value, 9) for n, value in curve.items()} for name, curve in found.items()} == {
        "even": {30: 0.3, 60: 0.1},
        "V": {30: 0.2},
    }


def test_a_criterion_of_ones_own_stands_beside_even_touches_and_v():
    """A worker process has not read the file: the task carries its text."""
    study = Study.named("strategies", OwnCriterion.named(f"{EXAMPLE}:K2"))
    tasks = study.tasks(small=True)
    CRITERIA.pop("K2")

    rows = study.module.run(np.random.default_rng(0), **tasks[-1])

    assert [task["name"] for task in tasks] == ["even", "V", "K2"]
    assert len(rows) == 3
    assert all(row["strategy"] == "K2" and 0 < row["rms_mm"] < 5 for row in rows)
    CRITERIA.pop("K2")


def test_a_study_that_compares_no_criteria_says_which_does():
    with pytest.raises(InputError, match="--criterion goes with touchcal study strategies"):
        Study.named("paper", OwnCriterion.named(f"{EXAMPLE}:K2"))
