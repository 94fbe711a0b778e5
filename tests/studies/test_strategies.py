"""Medians by strategy and number, counted by hand."""

from studies.strategies import medians

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
