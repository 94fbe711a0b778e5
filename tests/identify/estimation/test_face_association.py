"""What may have been met: sides of boxes that are no faces; and a belief in the shape of a calibration."""

import numpy as np
import pytest
from virtual_support import make_plan

from identify.estimation.face_association import BEYOND, SOLID, believe, free, provisional
from identify.estimation.face_association import _sides as sides
from identify.model.jig import Box, Face, Jig
from probe.virtual.batch import touch_batch
from probe.virtual.truth import Truth


def block(*faces):
    return Jig("block", faces, (Box((0, 0, 0), (100, 200, 300)),))


def test_a_block_has_six_sides_that_look_outwards():
    found = sides(block())

    normals = {tuple(side.normal.round(9).tolist()) for side in found}
    assert normals == {tuple((sign * row).tolist()) for row in np.eye(3) for sign in (1.0, -1.0)}
    middle = np.array([50.0, 100.0, 150.0])
    for side in found:
        assert side.name == SOLID
        centre = side.point(np.array(0.5), np.array(0.5))
        assert np.linalg.norm(centre - middle) == pytest.approx(side.normal @ (centre - middle))


def test_a_side_that_is_a_face_is_named_by_the_face():
    top = Face("top", np.array([0.0, 0, 300]), np.array([100.0, 0, 0]), np.array([0, 200.0, 0]))

    assert len(sides(block(top))) == 5
    assert not any(side.normal[2] > 0.5 for side in sides(block(top)))


def test_a_belief_about_touches_as_planned_is_a_calibration_of_all_free_parameters(arc_welder):
    plan = make_plan(arc_welder, 12)
    touches = touch_batch(arc_welder, Truth(arc_welder.theta), plan, np.random.default_rng(1))

    belief = believe(arc_welder, touches)

    assert belief.as_planned(touches).all()
    calibration = provisional(arc_welder, belief)
    assert len(calibration.estimated) == free(arc_welder).sum()
    np.testing.assert_array_equal(calibration.theta, belief.theta)
    assert max(abs(r.after_mm) for r in calibration.residuals.values()) < BEYOND * 0.05
    prior = arc_welder.prior[calibration.index]
    assert (np.sqrt(np.diag(calibration.covariance)) <= prior * (1 + 1e-9)).all()  # touches only tell more
