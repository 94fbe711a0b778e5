"""Registers as a controller saves them: numbers by index, and what is none told with its line."""

from pathlib import Path

import pytest

from identify.model.files import InputError
from probe.programs.registers import Numbers

PATH = Path("numreg.va")


def numbers(**elements):
    return Numbers(PATH, {int(k[1:]): v for k, v in elements.items()}, "R[{0}]", "NUMREG")


def test_a_register_holds_the_number_that_stands_first():
    assert numbers(r7=(12, " 3.5  'speed'"))[7] == 3.5
    assert numbers(r7=(12, "1")).line(7) == 12


@pytest.mark.parametrize(("text", "index"), [("Uninitialized", 7), ("", 7), ("1", 8)])
def test_what_is_no_number_is_told_with_the_file_to_save_again(text, index):
    with pytest.raises(InputError, match=rf"R\[{index}\] is .*, expected a number; save NUMREG again"):
        numbers(r7=(12, text))[index]


def test_the_log_of_a_plan_is_found_by_its_stamp():
    found = numbers(r1=(1, "0"), r20=(20, "123456"), r21=(21, "1"), r22=(22, "30"), r23=(23, "5000"))

    assert found.log(123456) == (20, 1, 30, 5.0)
