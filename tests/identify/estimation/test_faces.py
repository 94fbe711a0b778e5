"""A jig is called worse than stated as seldom as chance allows, and a face that stands elsewhere is named."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identified
from scipy.stats import kstest

from identify.estimation.faces import face_findings, surprise
from identify.model.calibration import FACE, SharedValue


def test_the_chance_of_a_jig_as_good_as_stated_is_uniform(rng):
    root = rng.standard_normal((6, 6))
    C = np.linalg.inv(np.eye(6) + root @ root.T)  # posterior of offsets with a prior of one
    scatter = np.linalg.cholesky(np.eye(6) - C)  # of their estimates

    chances = [surprise(scatter @ rng.standard_normal(6), C) for _ in range(500)]

    assert kstest(chances, "uniform").pvalue > 0.01


def test_faces_that_no_touch_tells_of_surprise_nobody():
    assert surprise(np.full(3, 9.0), np.eye(3)) == 1.0


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
