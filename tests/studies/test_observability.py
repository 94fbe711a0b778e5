"""Rank correlations: 1 where the better index always has the smaller error, whichever way an index points."""

import numpy as np
import pytest

from oed.criteria.criteria import CRITERIA
from studies.observability import correlations


@pytest.mark.parametrize("agrees", [True, False])
def test_an_index_that_orders_as_the_error_does_has_correlation_one(agrees):
    error = np.array([0.1, 0.2, 0.5, 0.7, 1.5])
    index = error if agrees else error[::-1]
    columns = {name: list(-index if criterion.larger_is_better else index) for name, criterion in CRITERIA.items()}

    found = correlations({"rms_mm": error.tolist(), **columns})

    assert all(value == pytest.approx(1.0 if agrees else -1.0) for value in found.values())
