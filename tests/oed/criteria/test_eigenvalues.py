"""Means of eigenvalues: sharpened ones, other exponents, and functions that are none."""

from dataclasses import replace

import numpy as np
import pytest
from informations import drawn

from oed import exact_design
from oed.criteria.criteria import CRITERIA


@pytest.mark.parametrize("name", ["O3", "E", "G"])
def test_what_is_sharpened_comes_near_to_the_criterion(name):
    criterion, _, M, other, _ = drawn(name, 9)

    *_, sharpest = criterion.sharpened()

    for information in (M, other):
        assert sharpest.smooth(information) == pytest.approx(criterion.log(information), abs=0.01)


def test_a_row_with_other_words_is_all_that_another_power_mean_takes():
    rows = np.random.default_rng(4).normal(size=(200, 4))
    mean = replace(CRITERIA["O5"], name="power 2", degree=1.0, exponent=2.0, function=inverse_square_mean)

    design = exact_design(rows, 12, mean, iterations=20)

    assert 0.85 < design.efficiency <= 1
    assert design.value == pytest.approx(
        np.linalg.norm(np.linalg.inv(rows[design.indices].T @ rows[design.indices])) ** -1
    )


def inverse_square_mean(sigma):
    """One over the norm of the covariance."""
    return (sigma**-4).sum(axis=-1) ** -0.5


def test_a_function_that_is_no_mean_of_the_order_given_is_refused():
    with pytest.raises(ValueError, match=r"power 2: its function is no power mean of the eigenvalues of order 0.5"):
        replace(CRITERIA["O5"], name="power 2", degree=1.0, function=inverse_square_mean)
