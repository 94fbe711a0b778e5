"""Why a touch cannot be made, on touches spoiled on purpose; candidates themselves can all be made."""

import numpy as np
import pytest
from few_candidates import few

from oed.candidates.feasibility import FAILURES, Infeasibility, unreached

pytestmark = pytest.mark.xdist_group("few candidates")


def test_candidates_can_be_made_with_the_approaches_that_they_have():
    found, feasibility = few().candidates, few().feasibility

    assert (feasibility.check(found.face, found.q, found.approach) == Infeasibility.NONE).all()


def test_an_approach_holds_the_tip_off_the_face_by_as_much_as_the_cell_says():
    found, feasibility = few().candidates, few().feasibility
    cell = feasibility.cell

    approach, exists = feasibility.approach(found.face[:20], found.q[:20])

    assert exists.all()
    way = cell.kinematics.tip(approach, feasibility.theta)[0] - cell.kinematics.tip(found.q[:20], feasibility.theta)[0]
    np.testing.assert_allclose(way, cell.touch.approach * found.normal[:20], atol=1e-3)


def spoiled(kind, found):
    """The same touches, all with one mistake."""
    q, approach, face = found.q.copy(), found.approach.copy(), found.face.copy()
    if kind == Infeasibility.LIMITS:
        q[:, 5] += 2 * np.pi
    elif kind == Infeasibility.EDGE:
        face = np.roll(face, 1)
    elif kind == Infeasibility.APPROACH:
        approach[:, 5] += 2 * np.pi
    elif kind == Infeasibility.PATH:
        approach = q - (approach - q)  # from inside the jig
    return face, q, approach


@pytest.mark.parametrize("kind", [Infeasibility.LIMITS, Infeasibility.APPROACH, Infeasibility.PATH])
def test_a_touch_with_one_mistake_fails_at_that(kind):
    found, feasibility = few().candidates, few().feasibility

    assert set(feasibility.check(*spoiled(kind, found)).tolist()) <= {kind, Infeasibility.SEARCH}
    assert (feasibility.check(*spoiled(kind, found)) == kind).mean() > 0.9


def test_a_touch_of_another_face_than_that_under_the_wire_is_refused():
    found, feasibility = few().candidates, few().feasibility
    face, q, approach = spoiled(Infeasibility.EDGE, found)
    moved = face != found.face

    assert set(feasibility.check(face, q, approach)[moved].tolist()) <= {Infeasibility.TILT, Infeasibility.EDGE}


def test_a_face_whose_postures_all_fail_is_told_with_shares_and_reasons():
    feasibility = few().feasibility
    tally = np.zeros((len(feasibility.cell.jig.faces), len(Infeasibility)), dtype=int)
    tally[:, Infeasibility.NONE] = 1
    tally[2, Infeasibility.NONE], tally[2, Infeasibility.EDGE], tally[2, Infeasibility.JIG] = 0, 30, 70

    (sentence,) = unreached(feasibility, tally)

    assert sentence.startswith(f"face '{feasibility.cell.jig.faces[2].name}' cannot be touched: of 100 postures")
    assert f"70% {FAILURES[Infeasibility.JIG]}, 30% {FAILURES[Infeasibility.EDGE]}" in sentence
