"""Points laid over others: rigid motions leave nothing, and the scale is the one that was planted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from studies.scale import laid_over


@given(st.integers(0, 2**31), st.floats(0.5, 2.0))
def test_a_moved_and_scaled_set_has_its_scale(seed, scale):
    rng = np.random.default_rng(seed)
    onto = rng.uniform(-100, 100, (12, 3))
    R = Rotation.random(rng=rng)

    rms, found = laid_over(R.apply(onto) * scale + rng.uniform(-50, 50, 3), onto)

    assert found == pytest.approx(scale)
    assert rms == pytest.approx(
        abs(scale - 1) * np.sqrt(((onto - onto.mean(axis=0)) ** 2).sum(axis=1).mean()), abs=1e-6
    )


def test_what_is_left_is_no_more_than_scipy_leaves(rng):
    points, onto = rng.normal(size=(2, 20, 3))

    rms, _ = laid_over(points, onto)

    _, left = Rotation.align_vectors(onto - onto.mean(axis=0), points - points.mean(axis=0))
    assert rms == pytest.approx(left / np.sqrt(20))


def test_a_mirror_image_is_no_rigid_motion(rng):
    onto = rng.normal(size=(10, 3))

    assert laid_over(onto * [1, 1, -1], onto)[0] > 0.1
