"""Touches moved continuously: better, still on their faces, still feasible, by every kind of criterion."""

from dataclasses import replace

import numpy as np
import pytest

from oed.candidates.feasibility import Infeasibility
from oed.refinement.coordinate import APART


def test_moved_touches_tell_more(information, criterion, chosen, moved):
    before, after = (criterion.phi(information(touches)) for touches in (chosen, moved))

    assert after > 1.005 * before


def test_moved_touches_lie_on_their_faces_inside_the_inset_and_the_tilt(offered, moved):
    cell = offered.cell
    tip, R = cell.kinematics.tip(moved.q, cell.theta)
    cosine = -(R[:, :, 2] * moved.normal).sum(axis=1)
    at_end = tip - cell.wire.radius * np.sqrt(np.maximum(1 - cosine**2, 0))[:, None] * moved.normal

    for i, face in enumerate(moved.faces):
        mine = moved.face == i
        at, inset = face.fractions(at_end[mine]), offered.candidates.margins.inset[i] / face.size
        assert at_end[mine] @ face.normal == pytest.approx(face.offset, abs=1e-3)  # [mm], a micrometre
        assert moved.point[mine] == pytest.approx(at_end[mine], abs=1e-3)
        assert (at >= inset - 1e-6).all()
        assert (at <= 1 - inset + 1e-6).all()
    assert (cosine >= np.cos(cell.touch.max_tilt) - 1e-9).all()


def test_moved_touches_are_approached_along_the_normal_with_the_same_wire(offered, moved):
    cell = offered.cell
    (tip, R), (above, turned) = (cell.kinematics.tip(q, cell.theta) for q in (moved.q, moved.approach))

    assert above - tip == pytest.approx(cell.touch.approach * moved.normal, abs=1e-3)
    assert turned == pytest.approx(R, abs=1e-6)


def test_moved_touches_can_be_made(offered, moved):
    assert (offered.feasibility.check(moved.face, moved.q, moved.approach) == Infeasibility.NONE).all()


def test_no_two_moved_touches_become_one(moved, chosen):
    for i in range(len(moved)):
        near = np.linalg.norm(moved.point - moved.point[i], axis=1) < APART[0]
        alike = np.abs(moved.q - moved.q[i]).max(axis=1) < APART[1]
        already = np.abs(chosen.q - chosen.q[i]).max(axis=1) < APART[1]
        assert not (near & alike & ~already).any()


def test_no_small_step_along_the_face_beats_what_ipopt_found(offered, refinement, criterion, information, chosen, rng):
    """Random feasible steps around the optimum, brought back to the face by inverse kinematics."""
    M, one = information(chosen), chosen.take(np.array([3]))
    f = refinement.coordinates.rows(one.expected_rows(offered.cell))[0]
    C = np.linalg.inv(M - np.outer(f, f))
    S = criterion.slope(M - np.outer(f, f))

    def worth(q):
        many = one.take(np.zeros(len(q), dtype=int))
        rows = refinement.coordinates.rows(replace(many, q=q).expected_rows(offered.cell))
        return ((rows @ S) * rows).sum(axis=1) / (1 + ((rows @ C) * rows).sum(axis=1))

    best = refinement.best(one, C[None], S[None])[0]

    steps = best + 0.02 * rng.standard_normal((2000, len(best)))
    around, _ = refinement.approaches(one.take(np.zeros(len(steps), dtype=int)), steps)
    assert worth(best[None])[0] >= worth(one.q)[0]
    assert len(around) > 5  # the best lies in a corner, with the wire as steep as it may be
    assert worth(around.q).max() <= 1.001 * worth(best[None])[0]
