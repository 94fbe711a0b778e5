"""Axes and colours of charts."""

import numpy as np
import pytest

from identify.report.svg import NOTHING, axis, colour


@pytest.mark.parametrize("values", [[0.0], [], [1e-9, 2e-9], [-3.2, 17.0], [np.nan, 1.0], [5.0, 5.0]])
def test_an_axis_covers_its_values_with_a_few_round_ticks(values):
    found = axis("x", values)

    known = [v for v in values if np.isfinite(v)]
    assert all(found.lower <= v <= found.upper for v in known)
    assert 2 <= len(found.ticks) <= 10
    assert found.lower < found.upper


def test_colours_run_from_dark_to_light_and_grey_is_nothing():
    shades = colour(np.array([0.0, 1.0, np.nan]))

    assert shades == ["rgb(68,1,84)", "rgb(253,231,37)", NOTHING]
