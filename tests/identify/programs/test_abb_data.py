"""Aggregates of RAPID: nested, with expressions in them, and the place of every number."""

import pytest

from identify.model.files import InputError
from identify.programs.abb_data import aggregates, numbers_of
from identify.programs.source import Source

TARGET = "[[100.5,-20,3E2],[1,0,0,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"


def read(text):
    return aggregates(Source("p.mod", text), text)


def test_a_target_has_the_shape_and_the_numbers_of_a_target():
    text = f"CONST robtarget p1:={TARGET};"

    (target,) = read(text)

    assert target.shape == "3,4,4,6"
    assert text[target.start : target.end] == TARGET
    numbers = numbers_of(target)
    assert [number.value for number in numbers[:3]] == [100.5, -20, 300]
    assert all(text[number.start : number.end] == number.text for number in numbers)


def test_expressions_are_values_but_no_numbers_and_have_no_shape():
    (found,) = read("p:=[f(1,2),[a{1,2},3]];")

    assert [item.text for item in found.items[1].items] == ["a{1,2}", "3"]
    assert found.items[0].text == "f(1,2)"
    assert [number.value for number in numbers_of(found)] == [3]
    assert found.shape == ""


def test_aggregates_stand_one_after_the_other():
    assert [found.shape for found in read("a:=[[1,2]]; b:=[[1],[2]];")] == ["2", "1,1"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("x\np:=[1,2;", "p.mod:2: column 8: found"), ("p:=[1,,2];", "expected a value in the"), ("p:=[[1,2]", "the end")],
)
def test_an_aggregate_that_does_not_close_is_refused_with_its_place(text, sentence):
    with pytest.raises(InputError) as error:
        read(text)

    assert sentence in str(error.value)
