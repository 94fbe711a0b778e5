"""Information of rows, by other ways to compute it; what is no such matrix is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oed.design.matrix import BLOCK, blocks, checked_prior, information, seen, sensitivities, whitener


def test_a_weight_counts_as_repeats(rng):
    rows, times = rng.normal(size=(6, 3)), np.array([0, 1, 2, 3, 1, 2])

    np.testing.assert_allclose(information(rows, times), information(np.repeat(rows, times, axis=0)), atol=1e-12)


@given(st.integers(0, 100), st.integers(1, 7))
def test_blocks_cover_every_row_once(count, size):
    rows = np.arange(count)

    parts = [rows[block] for block in blocks(count, size)]

    assert np.concatenate([*parts, np.zeros(0, int)]).tolist() == rows.tolist()
    assert all(0 < len(part) <= size for part in parts)


def test_sensitivities_are_the_diagonal_over_more_rows_than_a_block(rng):
    rows, S = rng.normal(size=(BLOCK + 3, 2)), np.array([[2.0, 0.5], [0.5, 1.0]])

    d = sensitivities(rows, S)

    np.testing.assert_allclose(d, 2 * rows[:, 0] ** 2 + rows[:, 0] * rows[:, 1] + rows[:, 1] ** 2, atol=1e-12)


def test_whitened_rows_have_unit_information_whatever_their_units(rng):
    rows = rng.normal(size=(20, 4)) * [1e-6, 1.0, 1e3, 1e6]

    T = whitener(information(rows))

    np.testing.assert_allclose(information(rows @ T), np.eye(4), atol=1e-9)


def test_directions_that_no_row_sees_are_parted_from_those_that_are_seen(rng):
    rows = rng.normal(size=(9, 3)) @ rng.normal(size=(3, 5))

    T, unseen = seen(information(rows))

    np.testing.assert_allclose(information(rows @ T), np.eye(3), atol=1e-8)
    assert unseen.shape == (5, 2)
    assert np.abs(rows @ unseen).max() < 1e-6


def test_a_prior_that_is_not_symmetric_is_refused():
    with pytest.raises(ValueError, match="prior: not symmetric; give the information matrix"):
        checked_prior(np.array([[1.0, 0.5], [0.0, 1.0]]), 2)
