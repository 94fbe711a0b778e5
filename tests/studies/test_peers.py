"""What peers are judged by: the D-criterion of weights, and medians only where all arrived."""

import numpy as np
import pytest

from studies.peers import _phi, middle


def test_the_criterion_of_equal_weights_is_that_of_the_mean_information(rng):
    X = rng.standard_normal((40, 3))

    assert _phi(X, np.full(40, 1 / 40)) == pytest.approx(np.linalg.det(X.T @ X / 40) ** (1 / 3))


def test_a_racer_that_did_not_arrive_once_has_no_median():
    table = {"data": ["a", "a", "a"], "method": ["m", "m", "n"], "cpu_s": [1.0, float("nan"), 2.0]}

    assert np.isnan(middle(table, "a", "m", "cpu_s"))
    assert middle(table, "a", "n", "cpu_s") == 2.0
    assert np.isnan(middle(table, "b", "m", "cpu_s"))
