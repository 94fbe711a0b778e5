"""Column generation over the manifold, for every kind of criterion, one of these tests' own among them."""

import numpy as np
import pytest

from oed.candidates.feasibility import Infeasibility
from oed.refinement.certificate import generate_columns


@pytest.fixture(scope="package")
def manifold(offered, refinement, criterion, best):
    bound = best.bound(np.ones(len(offered.candidates), dtype=bool))
    return generate_columns(refinement, offered.candidates, best.rows, criterion, bound, rounds=2)


def test_no_design_beats_the_bound_over_the_manifold(best, criterion, information, manifold, moved, chosen, rng):
    n, P, F = len(chosen), best.coordinates.precision, manifold.rows
    sets = [rng.choice(len(F), n, replace=False) for _ in range(50)]

    rivals = [P + F[s].T @ F[s] for s in sets] + [information(touches) for touches in (chosen, moved)]

    assert max(criterion.phi(M) for M in rivals) <= manifold.certificate.level
    assert manifold.relaxation.level <= manifold.certificate.level * (1 + 5e-3)  # the gap of a relaxation


def test_polished_touches_join_the_candidates_and_can_be_made(offered, manifold):
    new = manifold.touches.take(np.arange(len(offered.candidates), len(manifold.touches)))

    assert len(new) == manifold.certificate.joined > 0
    assert (offered.feasibility.check(new.face, new.q, new.approach) == Infeasibility.NONE).all()


def test_better_candidates_allow_better_weights(offered, best, manifold):
    alone = best.bound(np.ones(len(offered.candidates), dtype=bool))

    assert manifold.relaxation.value != alone.value
    assert manifold.relaxation.level >= alone.level / (1 + alone.gap)


def test_touches_that_no_clear_way_joins_stay_out(offered, refinement, best):
    bound = best.bound(np.ones(len(offered.candidates), dtype=bool))

    manifold = generate_columns(
        refinement,
        offered.candidates,
        best.rows,
        best.measure,
        bound,
        joined=lambda touches: np.zeros(len(touches), bool),
    )

    assert len(manifold.touches) == len(offered.candidates)


def test_a_certificate_says_how_densely_it_was_priced(offered, manifold):
    certificate = manifold.certificate

    assert certificate.priced == len(offered.candidates) + certificate.joined
    assert 0 < certificate.polished <= 32 * certificate.rounds
    assert f"{certificate.priced} on a grid" in certificate.covers
    assert "a search, not a proof" in certificate.covers


def test_the_bound_on_the_candidates_is_that_of_the_relaxation(criterion, best, offered):
    bound = best.bound(np.ones(len(offered.candidates), dtype=bool))

    gains = np.einsum("ij,jk,ik->i", best.rows, bound.support, best.rows)

    level = np.sum(bound.support * best.coordinates.precision) + best.n * gains.max()
    assert abs(level / bound.level - 1) < 1e-6
    assert criterion.phi(bound.information) <= bound.level
