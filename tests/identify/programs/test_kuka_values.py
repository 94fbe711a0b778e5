"""Structures of KRL: numbers with their places, whole numbers in three notations, and braces that do not match."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from identify.model.files import InputError
from identify.programs.kuka_values import Component, assigned, structures
from identify.programs.source import Source


def read(text):
    return structures(Source("p.dat", text), text)


def test_a_structure_has_its_type_and_its_components_in_any_case():
    text = "XP1={E6Pos: x 1.5,Y -2,Z 3E1,S 'B010',T 35}"

    (found,) = read(text)

    assert found.kind == "E6POS"
    assert {name: part.number.value for name, part in found.components.items() if part.number} == {
        "X": 1.5,
        "Y": -2.0,
        "Z": 30.0,
        "T": 35.0,
    }
    x = found.components["X"].number
    assert text[x.start : x.end] == "1.5"


@given(st.integers(0, 2**16))
def test_whole_numbers_are_read_in_three_notations(value):
    for text in (str(value), f"'B{value:b}'", f"'H{value:X}'"):
        assert Component(text).integer == value


def test_what_is_computed_is_no_number():
    (found,) = read("P={X a+1,Y 2}")

    assert found.components["X"].number is None
    assert found.components["X"].integer is None


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("P={X 1,X 2}", "X stands twice in one structure"),
        ("P={X 1\nY 2}", "a '{' that does not close in its line"),
        ("P={X 1}}", "a '}' that nothing has opened"),
    ],
)
def test_braces_that_do_not_match_are_refused(text, sentence):
    with pytest.raises(InputError) as error:
        read(text)

    assert sentence in str(error.value)


def test_assignments_are_told_from_declarations_and_comparisons():
    text = "DECL POS A={X 1}\n $Base=BASE_DATA[1]\nIF B==2 THEN\nC = 3 "

    assert [(name, value) for _, name, value in assigned(text)] == [("$BASE", "BASE_DATA[1]"), ("C", "3")]
