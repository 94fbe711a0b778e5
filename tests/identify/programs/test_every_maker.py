"""What holds of programs of every maker: bytes that stay, and programs that are broken anywhere."""

import re

import abb_text
import fanuc_text
import kuka_text
import pytest
import yaskawa_text
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import AS_DRAWN, SAME, wounded

from identify.model.files import InputError

SETUP = {"yaskawa": {"setup": yaskawa_text.SETUP}}
MAKERS = {  # the texts of a maker, and words of its language
    "fanuc": (fanuc_text, ["}", "{", ";", "=", "1", "-", "P[", "\n", "."]),
    "kuka": (kuka_text, ["}", "{", ";", "=", "1", "-", '"', "\n", ",", "S 16"]),
    "abb": (abb_text, ["]", "[", ";", "=", "1", "-", '"', "\n", ",", "!"]),
    "yaskawa": (yaskawa_text, ["=", "/", ",", "1", "-", "C", "\n", "."]),
}
FORM = r"[\d. *E+-]+"  # what numbers are made of


@pytest.mark.parametrize("maker", MAKERS)
@given(data=st.data())
@settings(max_examples=12, phases=AS_DRAWN)
def test_a_robot_that_is_as_believed_changes_no_byte(maker, data):
    text, _ = data.draw(MAKERS[maker][0].programs())

    assert MAKERS[maker][0].fixed(text, SAME, **SETUP.get(maker, {})).after == text.encode("latin-1")


@pytest.mark.parametrize("maker", MAKERS)
@given(data=st.data())
@settings(max_examples=40, phases=AS_DRAWN)
def test_mutilated_programs_end_in_a_sentence_or_in_a_program_of_the_same_form(maker, data):
    texts, words = MAKERS[maker]
    text = data.draw(wounded(texts.WHOLE, words))
    try:
        result = texts.fixed(text, **SETUP.get(maker, {}))
    except InputError:
        return

    assert re.sub(FORM, "#", result.after.decode()) == re.sub(FORM, "#", text)
