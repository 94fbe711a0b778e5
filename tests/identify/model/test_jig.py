"""Points of faces and their fractions."""

import numpy as np
import pytest

from identify.model.io.description import library, read_jig

JIGS = {name: read_jig(path) for name, path in library("jigs").items()}


@pytest.mark.parametrize("name", JIGS)
def test_a_point_of_a_face_has_the_fractions_it_was_made_from(name, rng):
    for face in JIGS[name].faces:
        st = rng.uniform(-1, 2, (20, 2))
        lifted = face.point(*st.T) + 7 * face.normal

        np.testing.assert_allclose(face.fractions(lifted), st, atol=1e-12)
        np.testing.assert_allclose(lifted @ face.normal, face.offset + 7, atol=1e-9)


@pytest.mark.parametrize("name", JIGS)
def test_a_point_lies_beside_a_face_by_the_longer_of_its_ways_to_the_edges(name, rng):
    for face in JIGS[name].faces:
        st = rng.uniform(-1, 2, (20, 2))
        nearest = face.point(*np.clip(st, 0, 1).T)  # of the rectangle
        way = face.point(*st.T) - nearest

        along = np.stack([way @ (side / np.linalg.norm(side)) for side in (face.u, face.v)])
        np.testing.assert_allclose(face.beside(face.point(*st.T) + 7 * face.normal), abs(along).max(axis=0), atol=1e-9)
        np.testing.assert_allclose(face.beside(nearest), 0, atol=1e-9)
