"""Numbers are replaced where they stand, and a skeleton is what is left without them."""

import re

from hypothesis import given
from hypothesis import strategies as st

from identify.programs.numbers import NUMBER, number
from identify.programs.records import Record
from identify.programs.writing import replaced, skeleton

values = st.lists(st.floats(-999, 999).map(lambda v: f"{v:.3f}"), min_size=6, max_size=6)
FORM = "P[1]{ X = %s, Y =   %s, Z = %s,\n W=%s P= %s R = %s};"


def numbers(text):
    """Those behind an equals sign."""
    return tuple(number(match, 1) for match in re.finditer(rf"=\s*({NUMBER})", text))


@given(values, values)
def test_a_text_with_numbers_replaced_is_the_form_filled_in_anew(old, new):
    before, filled = (
        FORM % tuple(old),
        replaced(
            FORM % tuple(old), [(n, v.rjust(n.lead)) for n, v in zip(numbers(FORM % tuple(old)), new, strict=True)]
        ),
    )

    assert [n.text for n in numbers(filled)] == new
    assert re.sub(rf"\s*({NUMBER})", "", filled.replace("P[1]", "")) == re.sub(
        rf"\s*({NUMBER})", "", before.replace("P[1]", "")
    )


@given(values, values)
def test_the_skeleton_is_the_same_whatever_the_numbers_are_and_shows_any_other_change(old, new):
    def of(text):
        return skeleton(text, [Record("P[1]", 1, "euler", numbers(text))])

    before, after = FORM % tuple(old), FORM % tuple(new)

    assert of(before) == of(after)
    assert of(before) != of(after.replace("P[1]", "P[2]"))
    assert of(before) != of(after.replace(";", ""))
