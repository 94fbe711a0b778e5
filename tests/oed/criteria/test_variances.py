"""Criteria of variances ask for the zone that they need."""

import numpy as np
import pytest
from scored import drawn, value

from oed.criteria.criteria import score


def test_a_moment_matrix_of_the_zone_gives_the_same_mean_variance():
    rows, zone, _ = drawn(4)
    moment = np.einsum("kai,kaj->ij", zone, zone) / len(zone)

    assert value("V", rows, moment) == pytest.approx(value("V", rows, zone))


def test_a_zone_criterion_without_a_zone_says_what_it_needs():
    with pytest.raises(ValueError, match=r"criterion 'V' scores the weld zone; give `zone`"):
        score("V", np.eye(3))


def test_the_worst_pose_cannot_be_told_from_a_moment_matrix():
    with pytest.raises(ValueError, match="'G' needs every pose"):
        score("G", np.eye(3), zone=np.eye(3))


def test_a_zone_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"zone: shape \(4, 3, 5\), expected finite numbers of shape \(poses, 3, 3\)"):
        score("V", np.eye(3), zone=np.zeros((4, 3, 5)))
