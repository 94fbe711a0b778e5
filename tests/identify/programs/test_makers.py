"""The table of makers: endings in any case, one maker an ending."""

import pytest

from identify.programs.makers import MAKERS, maker_of


@pytest.mark.parametrize("name", ["C:\\jobs\\seam.Jbi", "folder.mod/part.SRC", "a.b.c.Ls"])
def test_the_last_ending_decides_whatever_its_case(name):
    assert maker_of(name) is MAKERS["." + name.rsplit(".", 1)[1].lower()]


def test_programs_of_several_files_are_of_one_maker_that_pairs_them():
    assert MAKERS[".src"] is MAKERS[".dat"]
    assert [name for name, maker in MAKERS.items() if maker.pairs] == [".src", ".dat"]
