"""Regions to hold out: every point is in the one whose middle is nearest."""

import numpy as np
import pytest

from identify.estimation.folds import regions


def test_heaps_far_apart_are_the_regions(rng):
    heap = np.repeat(np.arange(4), 15)
    point = 100 * np.eye(4)[heap, :3] + rng.normal(size=(60, 3))

    label = regions(point, 4, rng)

    assert len(set(zip(heap, label, strict=True))) == 4


@pytest.mark.parametrize("count", [2, 5])
def test_a_region_is_what_is_nearest_to_its_middle(count, rng):
    point = rng.uniform(0, 300, (120, 3))

    label = regions(point, count, rng)

    middle = np.array([point[label == k].mean(axis=0) for k in range(count)])
    nearest = np.linalg.norm(point[:, None] - middle, axis=2).argmin(axis=1)
    np.testing.assert_array_equal(nearest, label)


def test_points_that_are_one_are_in_one_region(rng):
    assert len(set(regions(np.zeros((5, 3)), 3, rng))) == 1
