"""From cell file and options to a connection: what is stated wins, what makes no sense is refused."""

from dataclasses import replace

import numpy as np
import pytest
from virtual_support import make_plan

from identify.model.cell import Controller
from identify.model.files import InputError
from oed.campaigns.connection import Connection, connection
from probe.virtual.truth import Truth


@pytest.fixture
def cell(arc_welder):
    return replace(arc_welder, controller=Controller("/dev/ttyUSB3", "grbl", 9600, 0.1))


def test_the_cell_file_holds_where_nothing_else_is_said(cell):
    found = connection(cell)

    assert (found.port, found.protocol) == ("/dev/ttyUSB3", "grbl")
    assert found.options == {"baud": 9600, "axis_unit_deg": 0.1}


def test_what_a_user_gives_wins(cell):
    found = connection(cell, "sim", "line", baud=115200, truth="library:arc-welder", time_scale=20.0)

    assert (found.port, found.protocol, found.truth, found.time_scale) == ("sim", "line", "library:arc-welder", 20.0)
    assert found.options == {"baud": 115200}  # an axis unit is nothing to a line of degrees


@pytest.mark.parametrize(
    ("option", "sentence"),
    [
        ({"axis_unit_deg": 0.0}, "--axis-unit-deg is 0, expected"),
        ({"time_scale": -1.0}, "--time-scale is -1, expected"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(cell, option, sentence):
    with pytest.raises(InputError, match=sentence):
        connection(cell, **option)


def test_the_virtual_robot_speaks_no_linuxcnc(arc_welder, tmp_path):
    plan = make_plan(arc_welder, 1)

    with (
        pytest.raises(InputError, match="port sim speaks line or grbl, not linuxcnc; name the port of the linuxcnc"),
        Connection("sim", "linuxcnc").controller(arc_welder, plan, tmp_path / "journal"),
    ):
        pass


@pytest.mark.parametrize("protocol", ["line", "grbl"])
def test_a_virtual_robot_stands_at_the_first_approach(arc_welder, protocol, tmp_path):
    plan, there = make_plan(arc_welder, 1), Connection("sim", protocol, truth=Truth(arc_welder.theta))

    with there.controller(arc_welder, plan, tmp_path / "journal") as (controller, _):
        state = controller.state()

    assert controller.joints == 6
    np.testing.assert_allclose(state.q, plan.approach[0], atol=np.radians(1e-3))


@pytest.mark.parametrize("option", ["port", "protocol", "truth"])
def test_an_option_that_a_shell_left_empty_is_refused_and_not_taken_from_the_cell(cell, option):
    with pytest.raises(InputError, match=f"--{option} is empty"):
        connection(cell, **{option: ""})
