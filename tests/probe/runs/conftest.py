"""A small plan."""

import pytest
from sessions import small_plan

from identify.model.cell import Cell
from identify.model.touch import Plan


@pytest.fixture(scope="module")
def plan(arc_welder: Cell) -> Plan:
    return small_plan()
