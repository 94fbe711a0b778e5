"""Touches spread evenly: as many on each face as its area asks for, no touch twice, and apart from each other."""

import numpy as np
import pytest
from few_candidates import few
from scipy.spatial.distance import pdist

from oed.candidates.baselines import even, quotas

pytestmark = pytest.mark.xdist_group("few candidates")


@pytest.mark.parametrize("n", [1, 7, 40])
def test_quotas_sum_up_and_no_face_gets_more_than_it_has(n):
    found = few().candidates

    count = quotas(found, n)

    assert count.sum() == n
    assert (count <= found.number).all()


def test_more_touches_than_candidates_are_all_of_them():
    found = few().candidates

    np.testing.assert_array_equal(quotas(found, 10_000), found.number)


def test_no_touch_is_taken_twice_nor_one_that_is_not_allowed():
    found = few().candidates
    allowed = np.arange(len(found)) % 2 == 0

    chosen = even(found, 30, allowed)

    assert len(set(chosen.tolist())) == 30
    assert allowed[chosen].all()


def test_touches_are_farther_apart_than_those_drawn_at_random(rng):
    found = few().candidates
    face = int(np.argmax(found.number))
    of_face = np.flatnonzero(found.face == face)

    def closest(index):
        return pdist(found.point[index]).min()

    chosen = even(found.take(of_face), 8)

    random = [closest(rng.choice(of_face, 8, replace=False)) for _ in range(200)]
    assert closest(of_face[chosen]) > np.quantile(random, 0.8)
