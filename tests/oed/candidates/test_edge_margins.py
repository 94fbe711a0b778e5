"""Margins: 2.5 deviations of the tip at the postures that touch, within what the face has room for."""

from dataclasses import replace

import numpy as np
import pytest
from virtual_support import make_plan

from oed.candidates.edge_margins import EDGE, SHARE, SIGMAS, margins, warnings

BASE = 3.0  # [mm], 1 sigma of a base that may only be shifted: the tip is off by as much, along every axis


@pytest.fixture(scope="module")
def posed(arc_welder):
    plan = make_plan(arc_welder, 24)
    names = [face.name for face in arc_welder.jig.faces]
    return np.array([names.index(name) for name in plan.face]), plan.q


def shifted(cell, size):
    root = np.zeros((len(cell.theta), 3))
    root[:3] = size * np.eye(3)
    return root


def test_a_base_that_may_be_shifted_puts_the_tip_off_by_as_much_along_every_axis(arc_welder, posed):
    face, q = posed

    found = margins(arc_welder, shifted(arc_welder, BASE), arc_welder.theta, face, q)

    touched = np.unique(face)
    np.testing.assert_allclose(found.deviation[touched], BASE, rtol=1e-9)
    room = SHARE * np.stack([f.size for f in arc_welder.jig.faces])[touched] / 2
    np.testing.assert_allclose(found.inset[touched], np.minimum(SIGMAS * BASE, np.maximum(room, EDGE)), rtol=1e-9)
    np.testing.assert_allclose(found.overtravel[touched], SIGMAS * BASE, rtol=1e-9)


def test_faces_that_no_posture_touches_are_not_known(arc_welder, posed):
    face, q = posed

    found = margins(arc_welder, shifted(arc_welder, BASE), arc_welder.theta, face, q)

    others = np.setdiff1d(np.arange(len(arc_welder.jig.faces)), face)
    assert np.isnan(found.deviation[others]).all()


def test_a_search_is_no_longer_than_the_cell_allows(arc_welder, posed):
    short = replace(arc_welder, touch=replace(arc_welder.touch, approach=25.0, travel=30.0))

    found = margins(short, shifted(short, 100.0), short.theta, *posed)

    assert found.overtravel.max() == 5.0


def test_a_robot_known_well_needs_no_warning_and_one_known_badly_gets_one_for_faces_and_one_for_searches(
    arc_welder, posed
):
    touched = np.isin(np.arange(len(arc_welder.jig.faces)), posed[0])
    well, badly = (
        warnings(arc_welder, margins(arc_welder, shifted(arc_welder, size), arc_welder.theta, *posed), touched)
        for size in (0.1, 100.0)
    )

    assert well == ()
    assert ["edges of" in badly[0], "the search begins" in badly[1]] == [True, True]
    assert "250 mm" in badly[0]
