"""The page for the operator: everything filled in, and no search spoken of in a rehearsal."""

from types import SimpleNamespace

import numpy as np
import pytest

from probe.programs.makers import MAKERS
from probe.programs.options import UNTRIED, Options
from probe.programs.page import page
from probe.programs.part import Part


def written(maker, **options):
    touches = tuple(SimpleNamespace(number=k, id=f"t{k}", legs=(SimpleNamespace(q=np.zeros(6)),)) for k in (1, 2))
    chosen = Options(**options)
    part = Part(1, 1, touches, chosen, 123456, 5.0, SimpleNamespace(to_controller=np.degrees))
    return page(MAKERS[maker].instructions, "RI[1]", [part], chosen, ["mind the step"])


@pytest.mark.parametrize("maker", MAKERS)
def test_nothing_is_left_to_fill_in_and_nothing_is_claimed_that_was_not_tried(maker):
    text = written(maker)

    assert "{" not in text
    assert f"**{UNTRIED}**" in text
    assert text.index("mind the step") < text.index("stand as cell.yaml says")
    assert "| TC1 | t1 to t2 |" in text


@pytest.mark.parametrize("maker", MAKERS)
def test_a_rehearsal_searches_nothing_and_brings_nothing_back(maker):
    text = written(maker, rehearsal=True)

    assert "2 rehearsal in 1 file" in text
    assert "## After" not in text
    assert "Search at 100 % override" not in text
