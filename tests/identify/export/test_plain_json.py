"""JSON holds everything that was identified."""

import pytest
from exported import MICRO, ROBOTS, cell_of, wrong

from identify.export.exporting import export
from identify.model.io.description import library, read_robot


@pytest.mark.parametrize("name", ROBOTS)
def test_json_holds_everything(name, rng):
    result = export(wrong(cell_of(read_robot(library("robots")[name])), rng), "json")

    assert result.deviation.max_mm < MICRO
    assert result.deviation.max_deg < 1e-9


def test_joint_errors_travel_in_json(bending):
    assert export(bending, "json").deviation.max_mm < MICRO
