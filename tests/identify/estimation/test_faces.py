"""A jig is called worse than stated as often as it is, and a face that stands elsewhere is named."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identified

from identify.estimation.faces import BELIEVED, FACTORS, SOUND, WIDE, face_findings, probabilities
from identify.model.calibration import FACE, SharedValue


def test_factors_drawn_as_probable_as_they_are_said_to_be_are_found_that_often(rng):
    root = 3 * rng.standard_normal((8, 8))
    C = np.linalg.inv(np.eye(8) + root @ root.T)  # posterior of offsets, by tolerances WIDE times the stated ones
    noise = np.linalg.cholesky(C - C @ C)
    before = np.where(FACTORS == 1, SOUND, (1 - SOUND) / (len(FACTORS) - 1))

    sound, said = [], []
    for _ in range(2000):
        factor = rng.choice(FACTORS, p=before)
        true = factor / WIDE * rng.standard_normal(8)
        sound.append(factor == 1)
        said.append(probabilities((np.eye(8) - C) @ true + noise @ rng.standard_normal(8), C)[0])

    right = np.array(sound)[np.array(said) > BELIEVED].mean()
    assert right == pytest.approx(np.array(said)[np.array(said) > BELIEVED].mean(), abs=0.03)
    assert np.mean(said) == pytest.approx(SOUND, abs=0.03)


def test_faces_that_no_touch_tells_of_leave_the_jig_as_probable_as_before():
    assert probabilities(np.zeros(3), np.eye(3))[0] == pytest.approx(SOUND, abs=1e-4)


@pytest.fixture
def calibration(arc_welder):
    """All faces where they are drawn, known to a tenth of their tolerances."""
    faces = arc_welder.jig.faces
    shared = tuple(SharedValue(FACE + face.name, "mm", 0.0, face.tolerance) for face in faces)
    rows = np.hstack([np.zeros((len(faces), 1)), np.diag([(0.1 * face.tolerance) ** 2 for face in faces])])
    return identified(arc_welder, arc_welder.theta, shared=shared, shared_covariance=rows)


def changed(calibration, k, **values):
    shared = list(calibration.shared)
    shared[k] = replace(shared[k], **values)
    return replace(calibration, shared=tuple(shared))


def test_a_good_jig_gives_no_finding(calibration):
    assert list(face_findings(calibration)) == []


def test_a_face_ten_tolerances_off_is_named_with_way_and_sign(calibration, arc_welder):
    tolerance = arc_welder.jig.faces[2].tolerance

    (finding,) = face_findings(changed(calibration, 2, value=-10 * tolerance))

    assert finding.kind == "face"
    assert finding.text.startswith(f"'{arc_welder.jig.faces[2].name}' stands {-10 * tolerance:+.3f}")


def test_tolerances_that_were_widened_are_a_finding_about_the_jig(calibration, arc_welder):
    wide = calibration
    for k, face in enumerate(arc_welder.jig.faces):
        wide = changed(wide, k, scale=5 * face.tolerance, value=2 * face.tolerance)

    assert [finding.kind for finding in face_findings(wide)] == ["jig"]
