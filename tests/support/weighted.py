"""Small random candidates, zones and quadratic regression."""

import numpy as np

from oed.criteria.criteria import CRITERIA

CERTIFIED = [name for name, criterion in CRITERIA.items() if criterion.certified]
KINKED = ("O3", "E", "G")
SMOOTH = [name for name in CERTIFIED if name not in KINKED]


def small(seed, candidates=9, parameters=3, poses=3):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(candidates, parameters)), rng.normal(size=(poses, 3, parameters)), rng


def phi(name, M, zone=None):
    return CRITERIA[name].on(zone, len(M)).phi(M)
