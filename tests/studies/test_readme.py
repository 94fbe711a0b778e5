"""The README of the studies is made from the scripts."""

import pytest

from studies import PICTURES, STUDIES
from studies.engine import Study
from studies.readme import readme


def test_the_readme_of_the_studies_is_made_from_the_scripts():
    assert (PICTURES.parent / "README.md").read_text(encoding="utf-8") == readme()


@pytest.mark.parametrize("name", STUDIES)
def test_every_answer_has_figures_and_a_picture(name):
    story = Study.named(name).story

    assert any(digit in story.partition("Answer: ")[2] for digit in "0123456789")
    assert list(PICTURES.glob(f"{name}*.svg"))
