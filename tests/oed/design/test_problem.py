"""The problem of an exact design: faces by name, and questions without an answer."""

import numpy as np
import pytest
from small_designs import problem

from oed import approximate_design, exact_design


def test_quotas_call_faces_by_name():
    rows, _, _ = problem(7)
    face = np.array(["top", "side"])[np.arange(12) % 2]

    design = exact_design(rows, 6, face=face, quotas={"top": (5, 6)})

    assert np.sum(face[design.indices] == "top") >= 5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": np.full((12, 3), np.nan)}, "rows: 12 of 12 rows are not finite, the first is row 0"),
        ({"n": 2}, "n: 2 touches beside what is known determine at most 2 of 3 parameters; ask for 1 more"),
        ({"n": 13}, "n: 13 touches to choose and only 12 candidates left; add candidates, or allow repeats"),
        ({"n": None}, "n: give a number of touches, or both `cost` and `budget`"),
        ({"criterion": "F"}, "criterion 'F' is unknown; choose one of"),
        ({"criterion": "G"}, "criterion 'G' scores the weld zone; give `zone`"),
        ({"quotas": {0: (1, 2)}}, "quotas: they need `face`, the face of each of the 12 candidates"),
        ({"quotas": {0: (3, 6), 1: (3, 6)}, "face": np.arange(12) % 2}, "quotas: the faces need 6 touches"),
        ({"quotas": {3: (1, 2)}, "face": np.arange(12) % 2}, "quota of face 3: no candidate lies on it"),
        ({"quotas": {0: (3, 1)}, "face": np.arange(12) % 2}, "quota of face 0: it takes 1 more touches and needs 3"),
        ({"quotas": {0: (4, 5)}, "face": np.arange(12) // 3}, "quota of face 0: it has 3 candidates and needs 4"),
        ({"fixed": np.array([12])}, r"fixed: index 12 is outside 0 ... 11"),
        ({"fixed": np.arange(5)}, "n: 5 touches of which 5 are fixed leave none to choose"),
        ({"min_distance": 1.0}, "min_distance: it needs `positions`"),
        ({"min_distance": 9.0, "positions": np.eye(12, 3)}, "rules: found no set of 5 touches"),
        ({"cost": -np.ones(12), "budget": 3.0}, "cost: expected one positive number for each of the 12 candidates"),
        ({"cost": np.ones(12), "budget": 0.5, "n": None}, "budget: 0.5 is left, and the cheapest touch costs 1"),
        ({"seconds": -1.0}, "seconds: -1, expected more than 0"),
        ({"n": 5.5}, "n: 5.5, expected a whole number of touches"),
        ({"iterations": 0}, "iterations: 0, expected at least 1"),
        ({"relaxation": approximate_design(np.eye(3))}, "relaxation: of 3 candidates and criterion 'D', expected 12"),
    ],
)
def test_a_question_without_an_answer_gets_one_sentence(change, message):
    with pytest.raises(ValueError, match=message):
        exact_design(**{"rows": problem(16)[0], "n": 5, **change})
