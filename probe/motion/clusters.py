"""Groups of triangles that lie near each other, for bounding volumes tighter than one around a whole mesh."""

import numpy as np
from jaxtyping import Float, Int


def clusters(
    vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"], most: int
) -> list[Float[np.ndarray, "points 3"]]:
    """Corners of at most `most` groups of triangles, each split at the median of the longest extent.

    A bounding volume hierarchy is built like this (Ericson, Real-Time Collision Detection, 2005, section 6.2).
    """
    middle = vertices[triangles].mean(axis=1)
    groups = [np.arange(len(triangles))]
    while len(groups) < most:
        sizes = [float(np.ptp(middle[group], axis=0).max()) for group in groups]
        largest = int(np.argmax(sizes))
        if sizes[largest] <= 0:
            break
        group = groups.pop(largest)
        axis = int(np.ptp(middle[group], axis=0).argmax())
        order = group[np.argsort(middle[group, axis], kind="stable")]
        groups += [order[: len(order) // 2], order[len(order) // 2 :]]
    return [vertices[np.unique(triangles[group])] for group in groups]
