"""How large joint errors, deviations from the drawing and noise are on this arm: what predicts regions left out.

The problem is linear about a fit: whitened rows y = A x + noise, x in units of the stated priors. A model has four
numbers: the factor on the priors of the geometry, the ratio of the factor on the joint errors to it, the noise, and the
design effect `kappa` (Kish 1965), by which rows that share what the model lacks say less than independent ones. Each
model is judged by extrapolation: it is fitted above a quantile of a joint, a coordinate or the reach, and predicts what
lies below, and the reverse. The models are averaged by pseudo-BMA+ (Yao, Vehtari, Simpson and Gelman 2018), so that
what is not certain about the four numbers is part of every prediction.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.estimation.selection import FREE

LOOSE, GEOMETRY, ERROR = 0, 1, 2  # kinds of unknowns: without a prior, of the drawing, of the joint errors
CUT = 0.35  # share of the rows that a fold predicts
CAP = 25.0  # squared errors beyond it count no more, in variances
CERTAIN = 10.0  # degrees of freedom that the stated sigma is worth
CORRELATION = 0.04  # of errors beyond the data with each other: many rows are worth 25 independent predictions
HIDDEN, USUAL = (0.015, 2.0), (1.0, 1.5)  # factors on joint errors too small to show, or as stated: median, deviation
LEAST, MOST = 0.02, 0.3  # probability of the second, by few rows and by many
BOOTSTRAPS = 100
TINY = 1e-300  # of a density
NEGLIGIBLE = 2e-3  # weight of a model that is left out of the average
ENOUGH = 3000  # rows that choose the factors; all rows make the estimate
GEOMETRIES = 3.0 ** np.arange(-2, 4)  # factor on the geometry in units of the noise that weighs the rows
RATIOS = np.array([0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0])  # of the factor on joint errors to that on the geometry
KAPPAS = np.array([1.0, 3.0, 10.0, 30.0, 100.0])
NOISES = 1.25 ** np.arange(-12, 13)  # in units of the stated sigma


@dataclass(frozen=True, eq=False)
class Linear:
    """Rows y = A x + noise, in units of the stated sigma and of the stated priors."""

    A: Float[np.ndarray, "rows unknowns"]
    y: Float[np.ndarray, " rows"]
    kind: Int[np.ndarray, " unknowns"]

    def take(self, some: Bool[np.ndarray, " rows"] | Int[np.ndarray, " some"]) -> "Linear":
        """Some of the rows."""
        return Linear(self.A[some], self.y[some], self.kind)

    @property
    def normal_equations(self) -> tuple[np.ndarray, np.ndarray]:
        """A'A and A'y."""
        return self.A.T @ self.A, self.A.T @ self.y


@dataclass(frozen=True, eq=False)
class Models:
    """Weights of the models, an axis each for ratio, geometry, kappa and noise."""

    weight: Float[np.ndarray, "ratios geometries kappas noises"]

    @property
    def noise(self) -> float:
        """Root mean square of the noise, in units of the stated sigma."""
        return float(np.sqrt(self.weight.sum(axis=(0, 1, 2)) @ NOISES**2))

    @property
    def geometry(self) -> float:
        """Factor on the priors of the geometry, geometric mean."""
        return float(np.exp((self.weight * np.log(_factors()[0])).sum()))

    @property
    def errors(self) -> float:
        """Factor on the priors of the joint errors, geometric mean."""
        return float(np.exp((self.weight * np.log(_factors()[1])).sum()))

    def posterior(self, linear: Linear) -> "Posterior":
        """Mean and covariance of the unknowns over all models."""
        (G, b), total = linear.normal_equations, self.weight.sum(axis=(2, 3))
        weights, means, within = list[float](), list[np.ndarray](), np.zeros_like(G)
        scatter = self.weight * (KAPPAS[:, None] * NOISES**2)
        for j in np.flatnonzero(total.max(axis=1) > NEGLIGIBLE):
            scale = _scale(linear.kind, RATIOS[j])
            value, vector = _spectrum(G, scale)
            back, z = scale[:, None] * vector, vector.T @ (scale * b)
            for i in np.flatnonzero(total[j] > NEGLIGIBLE):
                h = GEOMETRIES[i] ** 2 / (1 + GEOMETRIES[i] ** 2 * value)
                weights.append(float(total[j, i]))
                means.append(back @ (h * z))
                within += (back * h) @ back.T * float(scatter[j, i].sum())
        w, x = np.array(weights) / sum(weights), np.array(means)
        mean = w @ x
        return Posterior(mean, within / sum(weights) + (x - mean).T @ ((x - mean) * w[:, None]), self.noise)


@dataclass(frozen=True, eq=False)
class Posterior:
    """The unknowns after the measurements, in units of their priors, and the noise in units of the stated sigma."""

    mean: Float[np.ndarray, " unknowns"]
    covariance: Float[np.ndarray, "unknowns unknowns"]
    noise: float


def average(linear: Linear, folds: Sequence[Bool[np.ndarray, " rows"]]) -> Models:
    """Weights of the models by how well they predict the rows of each fold from the others."""
    score = np.stack([_fold_scores(*parts) for parts in _without(linear, folds)])
    rows = len(linear.y)
    evidence = rows / (1 + (rows - 1) * CORRELATION)  # independent predictions that the rows are worth (Kish 1965)
    structure, noise = _log_priors(rows / max(int((linear.kind != ERROR).sum()), 1))
    share = np.random.default_rng(0).dirichlet(np.ones(len(score)), BOOTSTRAPS)
    stated = min(1.0, 1 / CORRELATION / rows)  # of the noise every row says something: sigma weighs as much less
    total = evidence * (share @ score.reshape(len(score), -1)) + (structure + noise * stated).ravel()
    weight = np.exp(total - total.max(axis=1, keepdims=True))
    weight = (weight / weight.sum(axis=1, keepdims=True)).mean(axis=0)
    return Models(weight.reshape(structure.shape))


def folds(
    q: Float[np.ndarray, "measured joints"], tip: Float[np.ndarray, "measured 3"], owner: Int[np.ndarray, " rows"]
) -> list[Bool[np.ndarray, " rows"]]:
    """Rows at the low and at the high end of every joint, of x, y and z, and of the reach."""
    values = [*q.T, *tip.T, np.linalg.norm(tip, axis=1)]
    ends = [np.quantile(value, [CUT, 1 - CUT]) for value in values]
    pairs = [(value, end) for value, end in zip(values, ends, strict=True) if np.ptp(value) > 1e-6]
    sides = [side for value, (low, high) in pairs for side in (value <= low, value >= high)]
    return [side[owner] for side in sides if 0 < side.sum() < len(side)]


def _without(
    linear: Linear, folds: Sequence[Bool[np.ndarray, " rows"]]
) -> Iterator[tuple[Linear, np.ndarray, np.ndarray]]:
    """The rows of each fold, and the normal equations of all others."""
    G, b = linear.normal_equations
    for fold in folds:
        out = linear.take(fold)
        own, right = out.normal_equations
        yield out, G - own, b - right


def _fold_scores(out: Linear, G: np.ndarray, b: np.ndarray) -> Float[np.ndarray, "ratios geometries kappas noises"]:
    """Mean log predictive density of the rows of a fold, given the normal equations of the others, by each model."""
    score = np.empty((len(RATIOS), len(GEOMETRIES), len(KAPPAS), len(NOISES)))
    for j, ratio in enumerate(RATIOS):
        scale = _scale(out.kind, ratio)
        value, vector = _spectrum(G, scale)
        P, z = (out.A * scale) @ vector, vector.T @ (scale * b)
        h = GEOMETRIES[:, None] ** 2 / (1 + GEOMETRIES[:, None] ** 2 * value)
        square = (out.y - (h * z) @ P.T) ** 2
        variance = 1 + KAPPAS[:, None] * (h @ (P * P).T)[:, None]  # in units of the noise
        ratio2, log = square[:, None] / variance, np.log(variance).mean(axis=-1)
        for k, noise in enumerate(NOISES):
            score[j, :, :, k] = -0.5 * np.minimum(ratio2 / noise**2, CAP).mean(axis=-1) - 0.5 * log - np.log(noise)
    return score


def _scale(kind: Int[np.ndarray, " unknowns"], ratio: float) -> Float[np.ndarray, " unknowns"]:
    return np.array([FREE, 1.0, ratio])[kind]


def _spectrum(G: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    value, vector = np.linalg.eigh(G * np.outer(scale, scale))
    return np.maximum(value, 0.0), vector


@lru_cache
def _factors() -> tuple[np.ndarray, np.ndarray]:
    """Factors on the priors of the geometry and of the joint errors, by each model."""
    ratio, geometry, kappa, noise = np.meshgrid(RATIOS, GEOMETRIES, KAPPAS, NOISES, indexing="ij")
    factor = geometry * noise * np.sqrt(kappa)
    return factor, ratio * factor


def _log_priors(each: float) -> tuple[np.ndarray, np.ndarray]:
    """Log-normal: a factor 3 around 1 for the geometry, and HIDDEN or USUAL for joint errors; of the noise chi-square.

    There are `each` rows for each unknown of the geometry. The design effect is at most the number of rows that share
    one deficit of the model (Kish 1965): with few of them it is near 1. Rows that the geometry alone can explain say
    nothing of joint errors: these are expected by the share of the rows that it leaves free.
    """
    geometry, errors = _factors()
    kappa, noise = np.meshgrid(KAPPAS, NOISES, indexing="ij")
    structure = -0.5 * (np.log(geometry) / np.log(3)) ** 2 - 0.5 * (np.log(kappa) / np.log(1 + each)) ** 2
    usual = LEAST + (MOST - LEAST) * max(1 - 1 / each, 0.0)
    parts = [share * _log_normal(errors, *size) for share, size in ((1 - usual, HIDDEN), (usual, USUAL))]
    stated = -CERTAIN * np.log(noise) - CERTAIN / 2 / noise**2
    return structure + np.log(np.sum(parts, axis=0) + TINY), np.broadcast_to(stated, structure.shape)


def _log_normal(x: np.ndarray, median: float, deviation: float) -> np.ndarray:
    """Density over log x, but for a constant."""
    return np.asarray(np.exp(-0.5 * (np.log(x / median) / np.log(deviation)) ** 2) / np.log(deviation))
