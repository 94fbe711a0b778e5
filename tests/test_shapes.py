"""The check of shapes that runs with the tests sees arrays, and leaves everything else to mypy."""

import numpy as np
import pytest
from jaxtyping import Float, TypeCheckError, jaxtyped
from shapes import checked


@jaxtyped(typechecker=checked)
def product(
    A: Float[np.ndarray, "m n"], x: Float[np.ndarray, " n"] | float, times: int = 1
) -> Float[np.ndarray, "..."]:
    return A @ np.broadcast_to(x, A.shape[1]) * times


def test_arrays_that_fit_pass():
    np.testing.assert_array_equal(product(np.ones((2, 3)), np.ones(3)), [3, 3])
    np.testing.assert_array_equal(product(np.ones((2, 3)), 2), [6, 6])


@pytest.mark.parametrize(
    ("A", "x"),
    [(np.ones((2, 3)), np.ones(2)), (np.ones(3), np.ones(3)), (np.ones((2, 3), dtype=int), np.ones(3)), ([[1.0]], 1.0)],
)
def test_arrays_that_do_not_fit_are_refused(A, x):
    with pytest.raises(TypeCheckError, match="Type-check error"):
        product(A, x)


def test_a_sum_over_the_only_axis_may_be_a_number():
    @jaxtyped(typechecker=checked)
    def total(x: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch"]:
        return x.sum(axis=-1)

    np.testing.assert_array_equal(total(np.ones((2, 3))), [3, 3])
    assert total(np.ones(3)) == 3


def test_what_is_no_array_is_left_to_mypy():
    np.testing.assert_array_equal(product(np.ones((1, 1)), 1.0, times=2.5), [2.5])
    assert checked(len) is len


def test_annotations_stay_as_they_were():
    def function(a: int, b: Float[np.ndarray, " n"]) -> str:
        return f"{a}{b}"

    before = dict(function.__annotations__)

    assert checked(function).__annotations__ == before
    assert function.__annotations__ == before
