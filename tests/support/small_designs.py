"""Small random problems of design, and the best of enumerated sets."""

import numpy as np

from oed.criteria.criteria import CRITERIA
from oed.design.constraints import Rules
from oed.design.memetic import Pool


def problem(seed, candidates=12, parameters=3, poses=4):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(candidates, parameters)), rng.normal(size=(poses, 3, parameters)), rng


def worth(name, rows, chosen, zone=None, prior=0):
    X = rows[list(chosen)]
    return CRITERIA[name].on(zone, X.shape[1]).phi(X.T @ X + prior)


def best_of(name, rows, sets, zone=None, prior=0):
    """The largest worth of any of the sets."""
    return max(worth(name, rows, chosen, zone, prior) for chosen in sets)


def exchanged(swaps, n, members=()):
    """A set completed to n touches, each time with the one that adds most, then improved by swaps until none helps."""
    pool = Pool(swaps, Rules(len(swaps.rows)), n)
    return pool.descend(pool.completed(np.array(members, dtype=int))).members
