"""Targets: the wire leans from the normal by its tilt, towards its azimuth, and its end meets the face."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identify.model.cell import Wire
from identify.model.jig import Face
from oed.candidates.targets import extent, targets

FACES = (
    Face("top", np.array([0.0, 0, 100]), np.array([200.0, 0, 0]), np.array([0, 100.0, 0])),
    Face("side", np.array([200.0, 0, 0]), np.array([0, 100.0, 0]), np.array([0, 0, 100.0])),
)
angles = st.floats(0, 6.28)


@given(st.integers(0, 1), st.floats(0, 1), st.floats(0, 1), st.floats(0, 1.2), angles, angles)
def test_the_wire_points_into_the_face_and_leans_as_asked(k, s, t, tilt, azimuth, roll):
    face = FACES[k]

    target = targets(FACES, np.array([k]), *(np.array([v]) for v in ([s, t], tilt, azimuth, roll)))

    wire = target.rotation[0, :, 2]
    assert wire @ face.normal == pytest.approx(-np.cos(tilt))
    u, v = face.u / face.size[0], face.v / face.size[1]
    lean = np.sin(tilt) * np.array([np.cos(azimuth), np.sin(azimuth)])
    np.testing.assert_allclose(-wire @ np.stack([u, v], axis=1), lean, atol=1e-9)
    np.testing.assert_allclose(face.fractions(target.point[0]), [s, t], atol=1e-9)
    assert face.normal @ target.point[0] == pytest.approx(face.offset)


def test_a_roll_turns_about_the_wire_alone():
    still, turned = (
        targets(FACES, np.array([0]), np.array([[0.5, 0.5]]), np.array([0.4]), np.array([1.0]), np.array([roll]))
        for roll in (0.3, 0.8)
    )

    turn = still.rotation[0].T @ turned.rotation[0]
    np.testing.assert_allclose(turn[:, 2], [0, 0, 1], atol=1e-12)
    assert abs(np.arctan2(turn[1, 0], turn[0, 0])) == pytest.approx(0.5)


@pytest.mark.parametrize("shape", ["point", "ball", "flat"])
def test_the_lowest_point_of_the_wires_end_lies_on_the_face(arc_welder, shape):
    tilt, radius = 0.6, 0.8
    cell = replace(arc_welder, wire=Wire(radius, shape))
    turn = np.linspace(0, 2 * np.pi, 3601)
    circle = radius * np.stack([np.cos(turn), np.sin(turn)])

    lowest = {  # below the middle of the end, whose wire leans by the tilt
        "point": 0.0,
        "ball": radius,
        "flat": (circle[0] * np.sin(tilt)).max(),  # of the rim
    }[shape]

    assert extent(cell, np.array([tilt]))[0] == pytest.approx(lowest)
