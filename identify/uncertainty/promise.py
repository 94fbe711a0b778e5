"""The tip error to expect in the weld zone."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

DRAWS = 400  # of the parameters, for the 95th percentile


@dataclass(frozen=True)
class Promise:
    """The tip error to expect in the weld zone, of robots drawn from what is known and of poses all over the zone."""

    rms_mm: float
    p95_mm: float


def promise(tip_rows: Float[np.ndarray, "poses 3 kept"], covariance: Float[np.ndarray, "kept kept"]) -> Promise:
    """Expected tip error of a robot whose parameters are known with a covariance, over poses.

    The 95 % error is that of the mixture over poses and over normally distributed parameters; a fixed draw stands for
    the integral.
    """
    variance = np.einsum("pik,kl,pil->p", tip_rows, covariance, tip_rows, optimize=True)
    value, vector = np.linalg.eigh(covariance)  # it may be singular
    root = vector * np.sqrt(np.maximum(value, 0.0))
    draws = root @ np.random.default_rng(0).standard_normal((len(root), DRAWS))
    error = np.linalg.norm(np.einsum("pik,kd->pdi", tip_rows, draws, optimize=True), axis=2)
    return Promise(float(np.sqrt(variance.mean())), float(np.percentile(error, 95)))
