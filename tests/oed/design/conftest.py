"""Rows of measurements, and a zone."""

import pytest
from several_rows import OWNER, P


@pytest.fixture
def rows(rng):
    return rng.standard_normal((len(OWNER), P))
