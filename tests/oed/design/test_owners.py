"""A weight on a measurement counts for all its rows."""

import numpy as np
import pytest
from several_rows import OWNER, P

from oed.design.relaxation import approximate_design


def test_a_weight_on_a_measurement_counts_for_all_its_rows(rows):
    design = approximate_design(rows, "D", 1e-5, owner=OWNER)

    each = rows * np.sqrt(design.weights)[OWNER][:, None]
    assert design.weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(each.T @ each, design.information, rtol=1e-6, atol=1e-9)
    gain = np.bincount(OWNER, np.einsum("ij,jk,ik->i", rows, np.linalg.inv(design.information), rows))
    assert gain.max() == pytest.approx(P, rel=1e-3)  # Kiefer and Wolfowitz: no measurement gains more than p


def test_measurements_of_one_row_are_weighed_as_before(rows):
    plain, owned = (approximate_design(rows, "D", owner=owner) for owner in (None, np.arange(len(rows))))

    np.testing.assert_array_equal(plain.weights, owned.weights)
