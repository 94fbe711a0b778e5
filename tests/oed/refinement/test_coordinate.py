"""Touches moved continuously: better, still on their faces, still feasible; and a bound over all others."""

import casadi as ca
import numpy as np
import pytest

from identify.uncertainty.information import touch_sigma
from oed.candidates.feasibility import Infeasibility
from oed.criteria.aim import Aim, mean_square
from oed.planning.candidate_set import offer
from oed.planning.visitable import Best
from oed.refinement.certificate import certify, level
from oed.refinement.coordinate import APART, Refinement, refine
from oed.refinement.simultaneous import Joint

N = 30


@pytest.fixture(scope="module")
def offered(arc_welder):
    return offer(arc_welder, np.random.default_rng(5), count=2000)


@pytest.fixture(scope="module")
def refinement(offered):
    return Refinement(offered.known, offered.feasibility)


@pytest.fixture(scope="module", params=["D", "V"])
def aim(request, offered):
    return Aim(mean_square(offered.tip) if request.param == "V" else None)


@pytest.fixture(scope="module")
def chosen(offered, aim):
    everything = np.ones(len(offered.found), dtype=bool)
    return offered.found.take(Best(offered, N, "D" if aim.B is None else "V")(everything, None))


def information(offered, touches):
    rows = offered.known.rows(touches.q, touches.normal, touch_sigma(offered.known.cell, touches.names()))
    return offered.known.precision + rows.T @ rows


@pytest.fixture(scope="module")
def moved(offered, refinement, aim, chosen):
    return refine(refinement, chosen, aim, sweeps=1)


def test_moved_touches_tell_more(offered, aim, chosen, moved):
    before, after = (level(aim, information(offered, touches)) for touches in (chosen, moved))

    assert after > 1.01 * before


def test_moved_touches_lie_on_their_faces_inside_the_inset_and_the_tilt(offered, moved):
    cell = offered.known.cell
    tip, R = cell.kinematics.tip(moved.q, cell.theta)
    cosine = -(R[:, :, 2] * moved.normal).sum(axis=1)
    at_end = tip - cell.wire.radius * np.sqrt(np.maximum(1 - cosine**2, 0))[:, None] * moved.normal

    for i, face in enumerate(moved.faces):
        mine = moved.face == i
        at, inset = face.fractions(at_end[mine]), offered.found.margins.inset[i] / face.size
        assert at_end[mine] @ face.normal == pytest.approx(face.offset, abs=1e-3)  # [mm], a micrometre
        assert moved.point[mine] == pytest.approx(at_end[mine], abs=1e-3)
        assert (at >= inset - 1e-6).all()
        assert (at <= 1 - inset + 1e-6).all()
    assert (cosine >= np.cos(cell.touch.max_tilt) - 1e-9).all()


def test_moved_touches_are_approached_along_the_normal_with_the_same_wire(offered, moved):
    cell = offered.known.cell
    (tip, R), (above, turned) = (cell.kinematics.tip(q, cell.theta) for q in (moved.q, moved.approach))

    assert above - tip == pytest.approx(cell.touch.approach * moved.normal, abs=1e-3)
    assert turned == pytest.approx(R, abs=1e-6)


def test_moved_touches_can_be_made(offered, moved):
    assert (offered.feasibility.check(moved.face, moved.q, moved.approach) == Infeasibility.NONE).all()


def test_no_two_moved_touches_become_one(moved, chosen):
    for i in range(N):
        near = np.linalg.norm(moved.point - moved.point[i], axis=1) < APART[0]
        alike = np.abs(moved.q - moved.q[i]).max(axis=1) < APART[1]
        already = np.abs(chosen.q - chosen.q[i]).max(axis=1) < APART[1]
        assert not (near & alike & ~already).any()


def test_no_small_step_along_the_face_beats_what_ipopt_found(offered, refinement, aim, chosen, rng):
    """Random feasible steps around the optimum, brought back to the face by inverse kinematics."""
    M, one = information(offered, chosen), chosen.take(np.array([3]))
    sigma = touch_sigma(offered.known.cell, one.names())
    f = offered.known.rows(one.q, one.normal, sigma)[0]
    C = np.linalg.inv(M - np.outer(f, f))
    W = aim.weight(C)

    def worth(q):
        rows = offered.known.rows(q, np.repeat(one.normal, len(q), axis=0), np.repeat(sigma, len(q)))
        return ((rows @ W) * rows).sum(axis=1) / (1 + ((rows @ C) * rows).sum(axis=1))

    best = refinement.best(one, C[None], W[None])[0]

    steps = best + 0.02 * rng.standard_normal((2000, len(best)))
    around, _ = refinement.approaches(one.take(np.zeros(len(steps), dtype=int)), steps)
    assert worth(best[None])[0] >= worth(one.q)[0]
    assert len(around) > 5  # the best lies in a corner, with the wire as steep as it may be
    assert worth(around.q).max() <= 1.001 * worth(best[None])[0]


def test_gradient_and_hessian_of_all_touches_are_those_of_finite_differences(offered, refinement, aim, chosen, rng):
    three = chosen.take(np.array([0, 10, 20]))
    joint = Joint(refinement.program, aim, 3)
    at = refinement.program.numbers(three)
    x, p = at.x.ravel() + 1e-3, at.p.ravel()
    lam = 0.1 * rng.standard_normal(at.g_limits.shape[1] * at.g_limits.shape[2])
    slope_of_g = ca.Function("g", joint.symbols, [ca.jtimes(ca.vec(joint.rows[2]), joint.symbols[0], ca.DM(lam), True)])

    def value(x):
        return -aim.value(offered.known.precision + (F := rows(x)).T @ F)

    def rows(x):
        q = x.reshape(3, -1)[:, : three.q.shape[1]]
        return offered.known.rows(q, three.normal, touch_sigma(offered.known.cell, three.names()))

    def slope(x):
        return np.array(joint.gradient(x, p)[1] + slope_of_g(x, p)).ravel()

    H = np.array(joint.hessian(x, p, 1.0, lam))

    step = 1e-6
    ways = step * np.eye(len(x))
    by_value = [(value(x + way) - value(x - way)) / (2 * step) for way in ways]
    by_slope = np.array([(slope(x + way) - slope(x - way)) / (2 * step) for way in ways])
    assert np.array(joint.gradient(x, p)[1]).ravel() == pytest.approx(np.array(by_value), abs=1e-4)
    assert np.triu(by_slope) == pytest.approx(H, abs=1e-4 * np.abs(H).max())


def test_moving_all_at_once_helps_where_moving_one_by_one_ends(refinement, offered, aim, chosen):
    alone, together = (refine(refinement, chosen, aim, sweeps=2, together=flag) for flag in (False, True))

    assert aim.value(information(offered, together)) > aim.value(information(offered, alone))


def test_no_design_beats_the_bound_over_the_manifold(offered, refinement, aim, moved, chosen, rng):
    P, F = offered.known.precision, offered.rows
    M0 = P + N * F.T @ F / len(F)  # any information gives a bound; that of the best weights gives a tight one

    found = certify(offered, refinement, aim, M0, N)

    sets = [rng.choice(len(F), N, replace=False) for _ in range(50)]
    rivals = [P + F[s].T @ F[s] for s in sets] + [information(offered, t) for t in (chosen, moved)]
    assert max(found.efficiency(aim, M) for M in rivals) <= 1
    assert found.gain >= 0
