"""Random touches and zones, and what a criterion makes of them."""

import numpy as np

from oed.criteria.criteria import score


def drawn(seed, touches=12, parameters=5, poses=4):
    """Rows of touches and tip Jacobians of a zone, of uneven size."""
    rng = np.random.default_rng(seed)
    scale = 10 ** rng.uniform(-1, 1, parameters)
    return rng.normal(size=(touches, parameters)) * scale, rng.normal(size=(poses, 3, parameters)) * scale, rng


def value(name, rows, zone, touches=None):
    return float(score(name, rows.T @ rows, len(rows) if touches is None else touches, zone))
