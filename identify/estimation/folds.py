"""Regions of space to hold out: errors at random rows flatter a model, errors in a region unseen do not."""

import numpy as np
from jaxtyping import Float, Int


def regions(
    point: Float[np.ndarray, "measured 3"], count: int, rng: np.random.Generator
) -> Int[np.ndarray, " measured"]:
    """The region of each point, by k-means (Lloyd 1982), started at points far from each other."""
    centre = point[[rng.integers(len(point))]]
    for _ in range(count - 1):
        distance = np.linalg.norm(point[:, None] - centre, axis=2).min(axis=1)
        centre = np.vstack([centre, point[np.argmax(distance)]])
    label = np.zeros(len(point), dtype=int)
    for _ in range(50):
        nearest = np.linalg.norm(point[:, None] - centre, axis=2).argmin(axis=1)
        if np.array_equal(nearest, label):
            break
        label = nearest
        centre = np.array([point[label == k].mean(axis=0) if (label == k).any() else centre[k] for k in range(count)])
    return label
