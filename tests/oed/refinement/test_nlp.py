"""The program of one touch says what the model of a measurement says, with slopes that differences confirm."""

import numpy as np
import pytest

from identify.estimation.selection import with_errors
from oed.planning.candidate_set import make_candidate_set
from oed.planning.visitable import Best
from oed.refinement.coordinate import Refinement

STEP = 1e-6


@pytest.fixture(scope="module")
def touches(arc_welder):
    """A few touches, and their program."""
    offered = make_candidate_set(arc_welder, np.random.default_rng(5), count=200)
    refinement = Refinement(Best(offered, 20, "V").coordinates, offered.feasibility)
    few = offered.candidates.take(np.arange(0, len(offered.candidates), 40))
    return few, refinement, refinement.program.numbers(few)


def test_rows_are_those_of_the_measurement_model(touches, arc_welder):
    few, refinement, at = touches

    rows = [np.array(refinement.program.values(x, p)[0]).ravel() for x, p in zip(at.x, at.p, strict=True)]

    np.testing.assert_allclose(rows, refinement.coordinates.rows(few.expected_rows(arc_welder)), atol=1e-6)


def test_rows_know_from_which_side_each_joint_comes(arc_welder):
    """A touch moves every joint a little: with backlash the sides of all six make its row."""
    loose = with_errors(arc_welder, ("backlash", "thermal", "compliance"))
    offered = make_candidate_set(loose, np.random.default_rng(5), count=200)
    few = offered.candidates.take(np.arange(0, len(offered.candidates), 40))
    refinement = Refinement(Best(offered, 20, "V").coordinates, offered.feasibility)
    at = refinement.program.numbers(few)

    rows = [np.array(refinement.program.values(x, p)[0]).ravel() for x, p in zip(at.x, at.p, strict=True)]

    np.testing.assert_allclose(rows, refinement.coordinates.rows(few.expected_rows(loose)), atol=1e-6)


def test_candidates_keep_all_limits_and_a_touch_beside_its_face_does_not(touches):
    few, refinement, at = touches

    def excess(x, p, lower, upper):
        g = np.array(refinement.program.values(x, p)[1]).ravel()
        return np.maximum(lower - g, g - upper).max()

    for i in range(len(few)):
        assert excess(at.x[i], at.p[i], *at.g_limits[:, i]) < 1e-3  # [mm]
        beside = at.p[i].copy()
        beside[3:6] += 500 * beside[6:9] / np.linalg.norm(beside[6:9])  # the face moved away along u
        assert excess(at.x[i], beside, *at.g_limits[:, i]) > 1e-2


def test_slopes_and_bends_are_those_of_differences(touches, rng):
    _, refinement, at = touches
    program = refinement.program
    x, p = at.x[0] + 1e-3, at.p[0]
    f, J = (np.array(part) for part in program.touch(x, p))
    w, lam = rng.standard_normal(len(f)), rng.standard_normal(at.g_limits.shape[2])
    steps = STEP * np.eye(len(x))

    def slope(x):
        return np.array(program.touch(x, p)[1]).T @ w + np.array(program.limits(x, p)[1]).T @ lam

    by_value = [(np.array(program.values(x + s, p)[0]) - np.array(program.values(x - s, p)[0])).ravel() for s in steps]
    by_slope = np.array([(slope(x + s) - slope(x - s)) / (2 * STEP) for s in steps])

    np.testing.assert_allclose(np.array(by_value).T / (2 * STEP), J, atol=1e-5 * np.abs(J).max())
    H = np.array(program.bent(x, p, w, lam))
    np.testing.assert_allclose(by_slope, H, atol=1e-5 * np.abs(H).max())
