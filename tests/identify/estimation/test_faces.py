"""A jig is called worse than stated as often as it is, and a face that stands elsewhere is named."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identified

from identify.estimation.discrepancy import ERROR, GEOMETRY, Linear
from identify.estimation.faces import BELIEVED, FACTORS, JOINT_ERRORS, SOUND, face_findings, probabilities
from identify.model.calibration import FACE, SharedValue

FACES, ROWS = 8, 60
KIND = np.repeat([GEOMETRY, ERROR, GEOMETRY], [10, 12, FACES])  # the faces last
STATED = np.repeat([0.0, 0.2], [22, FACES])


@pytest.fixture
def rows(rng):
    """Rows of a robot and of faces, which joint errors describe almost as well."""
    A = 3 * rng.standard_normal((ROWS, len(KIND)))
    A[:, 10 : 10 + FACES] = 0.3 * (A[:, -FACES:] + A[:, 10 : 10 + FACES])
    return Linear(A, np.zeros(ROWS), KIND)


def drawn(rows, factor, size, rng):
    """Touches of a jig that is so much worse than stated, by a robot with joint errors of this size."""
    scale = np.select([STATED > 0, KIND == ERROR], [factor * STATED, size], 1.0)
    return replace(rows, y=rows.A @ (scale * rng.standard_normal(len(KIND))) + rng.standard_normal(ROWS))


def test_factors_drawn_as_probable_as_they_are_said_to_be_are_found_that_often(rows, rng):
    before = np.where(FACTORS == 1, SOUND, (1 - SOUND) / (len(FACTORS) - 1))

    factors = rng.choice(FACTORS, 300, p=before)
    said = np.array([probabilities(drawn(rows, f, rng.choice(JOINT_ERRORS), rng), STATED)[0] for f in factors])

    sure = said > BELIEVED
    assert (factors == 1)[sure].mean() == pytest.approx(said[sure].mean(), abs=0.05)
    assert said.mean() == pytest.approx(SOUND, abs=0.05)


def test_faces_that_no_touch_tells_of_leave_the_jig_as_probable_as_before(rows, rng):
    unseen = replace(rows, A=rows.A * (STATED == 0))

    assert probabilities(drawn(unseen, 5.0, 0.1, rng), STATED)[0] == pytest.approx(SOUND, abs=1e-9)


def test_a_good_jig_is_not_accused_of_what_joint_errors_explain(rows, rng):
    touches = [drawn(rows, 1.0, 3.0, rng) for _ in range(40)]
    geometry = KIND != ERROR

    told = [probabilities(some, STATED)[0] < BELIEVED for some in touches]
    without = [
        probabilities(Linear(some.A[:, geometry], some.y, KIND[geometry]), STATED[geometry])[0] < BELIEVED
        for some in touches
    ]

    assert np.mean(without) > 0.5
    assert np.mean(told) < 0.05


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
