"""Touches of the arc-welder, chosen by criteria of every kind and moved to where they tell more."""

import numpy as np
import pytest
from own_criterion import Compromise

from oed.criteria.criteria import CRITERIA
from oed.planning.candidate_set import make_candidate_set
from oed.planning.visitable import Best
from oed.refinement.coordinate import Refinement, refine

N = 30
OWN = Compromise("own", 1.0, "rotation", "of these tests", (CRITERIA["D"], CRITERIA["A"]))


@pytest.fixture(scope="package")
def offered(arc_welder):
    return make_candidate_set(arc_welder, np.random.default_rng(5), count=2000)


@pytest.fixture(scope="package", params=["D", "V", "E", "G", OWN], ids=["D", "V", "E", "G", "own"])
def best(request, offered):
    return Best(offered, N, request.param)


@pytest.fixture(scope="package")
def refinement(offered, best):
    return Refinement(best.coordinates, offered.feasibility)


@pytest.fixture(scope="package")
def criterion(best):
    return best.measure


@pytest.fixture(scope="package")
def chosen(offered, best):
    return offered.candidates.take(best(np.ones(len(offered.candidates), dtype=bool), None))


@pytest.fixture(scope="package")
def moved(refinement, criterion, chosen):
    return refine(refinement, chosen, criterion, sweeps=1)


@pytest.fixture(scope="package")
def information(offered, best):
    def of(touches):
        return best.coordinates.information(best.coordinates.rows(touches.expected_rows(offered.cell)))

    return of
