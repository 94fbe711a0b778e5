"""Touches of the virtual cell, and a robot as drawn."""

import pytest
from virtual_support import make_plan, with_effects

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.virtual.truth import Truth


@pytest.fixture(scope="module")
def plan(arc_welder: Cell) -> Plan:
    return make_plan(arc_welder, 24)


@pytest.fixture
def exact(arc_welder: Cell) -> Truth:
    """The nominal robot, touching without scatter."""
    return with_effects(Truth(arc_welder.theta), sigma=0.0)
