"""Criteria of the table and one of one's own, with random informations to judge."""

import numpy as np
from own_criterion import Compromise

from oed.criteria.criteria import CRITERIA

OWN = Compromise("own", 1.0, "rotation", "of these tests", (CRITERIA["D"], CRITERIA["A"]))
ALL = {**CRITERIA, "own": OWN}


def drawn(name, seed, rows=7, parameters=4):
    """A criterion of a random zone, and two random informations of uneven size."""
    rng = np.random.default_rng(seed)
    criterion = ALL[name].on(rng.normal(size=(5, 3, parameters)), parameters)
    X, Y = rng.normal(size=(2, rows, parameters)) * 10 ** rng.uniform(-1, 1, (2, 1, parameters))
    return criterion, X, X.T @ X, Y.T @ Y, rng
