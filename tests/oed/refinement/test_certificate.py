"""The bound over the manifold, for every kind of criterion, one of these tests' own among them."""

import numpy as np

from oed.refinement.certificate import certify


def test_no_design_beats_the_bound_over_the_manifold(
    offered, refinement, criterion, best, information, moved, chosen, rng
):
    everything, n = np.ones(len(offered.candidates), dtype=bool), len(chosen)
    bound = best.bound(everything)

    found = certify(refinement, offered.candidates, best.rows, bound.support, n)

    P, F = best.coordinates.precision, best.rows
    sets = [rng.choice(len(F), n, replace=False) for _ in range(50)]
    rivals = [P + F[s].T @ F[s] for s in sets] + [information(touches) for touches in (chosen, moved)]
    assert max(criterion.phi(M) for M in rivals) <= found.level
    assert found.level >= bound.level * (1 - 1e-6)
    assert found.gain >= 0


def test_the_bound_on_the_candidates_is_that_of_the_relaxation(offered, criterion, best):
    bound = best.bound(np.ones(len(offered.candidates), dtype=bool))

    gains = np.einsum("ij,jk,ik->i", best.rows, bound.support, best.rows)

    level = np.sum(bound.support * best.coordinates.precision) + best.n * gains.max()
    assert abs(level / bound.level - 1) < 1e-6
    assert criterion.phi(bound.information) <= bound.level
