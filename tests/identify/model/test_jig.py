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
