"""A key ends in its unit: values inside and in files are the same quantities, both ways."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identify.model.cell import DEG, Device, TouchSettings, Zone
from identify.model.io.schema import TouchEntry, ZoneEntry
from identify.model.io.units import described, entry_of, field_of, outside, usual


@pytest.mark.parametrize(
    ("cls", "key", "field", "factor"),
    [
        (TouchSettings, "speed_mm_s", "speed", 1.0),
        (TouchSettings, "max_tilt_deg", "max_tilt", DEG),
        (Zone, "box_mm", "box", 1.0),
        (Device, "minutes", "minutes", 1.0),
    ],
)
def test_a_key_names_its_field_and_its_unit(cls, key, field, factor):
    assert field_of(cls, key) == (field, factor)


@given(st.floats(0.01, 10), st.floats(1, 89))
def test_an_entry_describes_what_it_was_made_from(sigma, tilt):
    settings = described(TouchSettings, TouchEntry(sigma_mm=sigma, max_tilt_deg=tilt))

    assert settings.max_tilt == pytest.approx(np.radians(tilt))
    again = entry_of(settings, TouchEntry)
    assert (again["sigma_mm"], again["max_tilt_deg"]) == pytest.approx((sigma, tilt), rel=1e-11)


def test_a_box_becomes_an_array_and_a_list_again():
    zone = described(Zone, ZoneEntry(box_mm=((0, 400), (0, 300), (0, 250))))

    assert zone.box.shape == (3, 2)
    assert entry_of(zone, ZoneEntry)["box_mm"] == [[0, 400], [0, 300], [0, 250]]


def test_whole_degrees_stay_whole():
    assert all(outside(degrees * DEG, DEG) == degrees for degrees in np.arange(0.0, 180.5, 0.5).tolist())
    assert usual(TouchSettings, "max_tilt_deg") == 50
