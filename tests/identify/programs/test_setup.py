"""How joints are counted: by the table, else by the cell, else as the maker does; backups beside the table."""

from dataclasses import replace

import pytest
from programs import CELL

from identify.model.files import InputError
from identify.model.joint_counting import JointCounting
from identify.programs.setup import Setup, counting, read_setups

MAKERS_OWN = ((2, 1, 1),)
CELLS = JointCounting(sign=(1, -1, 1, 1, 1, 1), coupled=((4, 3, 1),))


@pytest.mark.parametrize(
    ("cell", "setup", "maker", "coupled"),
    [
        (JointCounting(), Setup(), True, MAKERS_OWN),
        (JointCounting(), Setup(), False, ()),
        (CELLS, Setup(), True, CELLS.coupled),  # a cell that says how it counts is believed
        (CELLS, Setup(joints=JointCounting(coupled=((5, 4, -1),))), True, ((5, 4, -1),)),
        (CELLS, Setup(coupled=False), True, ()),
        (CELLS, Setup(coupled=True), False, MAKERS_OWN),
    ],
)
def test_couplings_are_those_of_the_first_that_says_something(cell, setup, maker, coupled):
    robot = replace(CELL.robot, counting=cell)

    assert counting(robot, setup, maker).coupled == coupled


def test_signs_of_the_table_win_over_those_of_the_cell():
    robot = replace(CELL.robot, counting=CELLS)

    assert counting(robot, Setup(), False).sign == CELLS.sign
    assert counting(robot, Setup(joints=JointCounting(sign=(-1,) * 6)), False).sign == (-1,) * 6


def test_two_tables_are_one_too_many(tmp_path):
    paths = [tmp_path / "a.yaml", tmp_path / "b.yaml"]

    with pytest.raises(InputError, match=r"b\.yaml: one YAML table is enough"):
        read_setups(paths, CELL.robot)


def test_no_table_is_the_setup_of_a_program_that_says_all_itself():
    setup = read_setups([], CELL.robot)

    assert (setup.frames, setup.tools, setup.coupled) == ({}, {}, None)
