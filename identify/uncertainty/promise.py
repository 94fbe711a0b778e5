"""The one promise: the tip error in the weld zone that 95 of 100 robots stay below at 95 % of the poses."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from jaxtyping import Float

INTERVAL = 1.96  # standard deviations to either end of a 95 % interval
SHARE = 95.0  # percent of the poses of a robot, and of the robots
ROBOTS = 1000  # drawn from what is known
SEED = 20


@dataclass(frozen=True)
class Promise:
    """The tip error to expect in the weld zone."""

    rms_mm: float
    """Over robots and poses."""
    p95_mm: float
    """95 of 100 robots stay below it at 95 % of the poses."""

    def sentences(self) -> tuple[str, ...]:
        """Why the RMS is the larger of the two, where it is."""
        if not self.rms_mm > self.p95_mm:
            return ()
        return (
            "the RMS is larger than the 95 %, since it counts all robots: also the few, fewer than 5 of 100, that miss "
            "many touches and stay badly known",
        )

    def __str__(self) -> str:
        return f"{self.p95_mm:.3f} mm at 95 % of the poses for 95 of 100 robots, RMS {self.rms_mm:.3f} mm"


@dataclass(frozen=True, eq=False)
class TipErrors:
    """Tip errors at the poses of the zone by one model: normal, e = mean + root z, the same z at all poses."""

    root: Float[np.ndarray, "poses 3 directions"]  # [mm], `Information.root` of the rows of the tip
    mean: Float[np.ndarray, "poses 3"] | None = None  # [mm], of this model beside the estimate; 0 if not given
    weight: float = field(default=1.0)  # probability of the model beside the others

    def variance(self) -> Float[np.ndarray, " poses"]:
        """Mean square error at each pose [mm^2]."""
        own = (self.root**2).sum(axis=(1, 2))
        return own if self.mean is None else own + (self.mean**2).sum(axis=1)

    def distances(self, robots: slice) -> Float[np.ndarray, "poses robots"]:
        """Distances of the tip from where the estimate has it [mm], of some of ROBOTS robots."""
        z = _normal(self.root.shape[2])[:, robots]
        if not np.isfinite(self.root).all():
            return np.full((len(self.root), z.shape[1]), np.inf)
        error = np.tensordot(self.root, z, axes=1)
        if self.mean is not None:
            error += self.mean[:, :, None]
        return np.asarray(np.sqrt(np.einsum("pik,pik->pk", error, error)))


def promise(*models: TipErrors) -> Promise:
    """The promise over one model of what is known, or over several by their weights.

    Infinite where what the zone needs is not determined. The draws are the same each time, so that promises compare.
    """
    weight = np.array([model.weight for model in models])
    share = weight / weight.sum()
    ends = np.round(np.concatenate([[0.0], np.cumsum(share)]) * ROBOTS).astype(int)
    errors = [model.distances(slice(*ends[i : i + 2])) for i, model in enumerate(models)]
    square = sum(s * model.variance().mean() for s, model in zip(share, models, strict=True))
    return _of(np.concatenate(errors, axis=1), float(square))


def promise_over(
    tip: Float[np.ndarray, "poses 3 directions"],
    gain: Float[np.ndarray, "robots directions"],
    axes: Float[np.ndarray, "robots directions directions"],
) -> Promise:
    """The promise over robots that were told different things, of what was known alike before.

    `tip` are rows of the tip in directions of unit deviation before [mm]. The information that was added is
    axes diag(gain) axes' in these directions: errors are tip axes (1 + gain)^(-1/2) z, and shrink as it grows.
    """
    robots, k = gain.shape
    each, flat = ROBOTS // robots, tip.reshape(-1, k)
    z = _normal(k)[:, : robots * each].reshape(k, robots, each).transpose(1, 0, 2)
    x = axes @ (z / np.sqrt(1 + gain)[:, :, None])
    error = flat @ x.transpose(1, 0, 2).reshape(k, -1)
    square = np.einsum("rik,rik,rk->", (flat.T @ flat) @ axes, axes, 1 / (1 + gain)) / robots / len(tip)
    return _of(np.linalg.norm(error.reshape(len(tip), 3, -1), axis=1), float(square))


def _of(distances: Float[np.ndarray, "poses robots"], square: float) -> Promise:
    """The promise by errors of robots and their mean square [mm, mm^2]."""
    of_robots = np.percentile(distances, SHARE, axis=0, method="inverted_cdf")
    return Promise(float(np.sqrt(square)), float(np.percentile(of_robots, SHARE, method="inverted_cdf")))


@lru_cache(maxsize=8)
def _normal(directions: int) -> Float[np.ndarray, "directions robots"]:
    """Standard normal numbers, each direction at the same quantiles in an order of its own (Latin hypercube)."""
    from scipy.special import ndtri

    quantiles = ndtri((np.arange(ROBOTS) + 0.5) / ROBOTS)
    return np.random.default_rng(SEED).permuted(np.tile(quantiles, (directions, 1)), axis=1)


def worst_deviation(errors: TipErrors) -> float:
    """Standard deviation of the tip in its worst direction [mm], at all but a tenth of the poses."""
    return float(np.percentile(np.linalg.svd(errors.root, compute_uv=False)[:, 0], 90))


def deviations(errors: Sequence[TipErrors]) -> Float[np.ndarray, " poses"]:
    """Root mean square tip error at each pose [mm], over models by their weights."""
    weight = np.array([model.weight for model in errors])
    return np.asarray(np.sqrt(np.average([model.variance() for model in errors], axis=0, weights=weight)))
