"""Faces that stand elsewhere than the jig file says, and a jig that is worse than its tolerance."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from identify.estimation.problem import Problem
from identify.estimation.robust import Estimate, estimate
from identify.model.calibration import FACE, Calibration, Finding
from identify.uncertainty.promise import INTERVAL

WIDE = 5.0  # times its tolerances that a jig may be off, for the fit that shows how far it is
FACTORS = 1.25 ** np.arange(13)  # times its tolerances that a jig may be off
SOUND = 0.5  # probability of a jig as good as stated, before it is touched
BELIEVED = 0.5  # and of one that is not called worse, afterwards
NAMED = 4.0  # standard deviations that the tolerance does not explain


def with_jig_as_it_is(problem: Problem, fit: Estimate) -> tuple[Problem, Estimate]:
    """The problem with the tolerances of all faces as wide as the touches show them to be, and its estimate.

    A fit that hardly holds the faces tells how probable each factor on their tolerances is. A fit that holds them as
    stated would take their offsets for noise.
    """
    places = _places(problem)
    if not len(places):
        return problem, fit
    wide = _scaled(problem, places, WIDE)
    probability = probabilities(*_offsets(wide, estimate(wide, problem.theta(fit.x), fit.used), places))
    if probability[0] > BELIEVED:
        return problem, fit
    factor = float(np.sqrt(probability[1:] @ FACTORS[1:] ** 2 / probability[1:].sum()))
    scaled = _scaled(problem, places, factor)
    return scaled, estimate(scaled, problem.theta(fit.x), fit.used)


def probabilities(b: Float[np.ndarray, " faces"], C: Float[np.ndarray, "faces faces"]) -> Float[np.ndarray, " factors"]:
    """Probability of each of FACTORS on the tolerances, after a fit by WIDE times as wide ones.

    b are the estimates and C their posterior covariance, in units of the wide tolerances. With an eigenvalue s of
    1 - C, an estimate is s times the sum of the true offset and of noise with variance (1 - s) / s.
    """
    s, vector = np.linalg.eigh(np.eye(len(b)) - C)
    s = np.clip(s, 1e-6, 1 - 1e-6)
    variance = s**2 * (FACTORS[:, None] / WIDE) ** 2 + s * (1 - s)
    log = -0.5 * (np.log(variance) + (vector.T @ b) ** 2 / variance).sum(axis=1)
    weight = np.exp(log - log.max()) * np.where(FACTORS == 1, SOUND, (1 - SOUND) / (len(FACTORS) - 1))
    return np.asarray(weight / weight.sum())


def _places(problem: Problem) -> Int[np.ndarray, " faces"]:
    """Places of the offsets of touched faces among the unknowns."""
    touched = {FACE + name for name in problem.rows.face}
    return np.array([i for i, name in enumerate(problem.unknowns.names) if name in touched], dtype=int)


def _offsets(
    problem: Problem, fit: Estimate, places: Int[np.ndarray, " faces"]
) -> tuple[Float[np.ndarray, " faces"], Float[np.ndarray, "faces faces"]]:
    C = problem.of_unknowns(problem.covariance(fit.x, fit.weight))
    return problem.unknown(fit.x)[places], C[np.ix_(places, places)]


def _scaled(problem: Problem, places: Int[np.ndarray, " faces"], factor: float) -> Problem:
    """The problem with wider tolerances of faces."""
    unknowns, first = problem.unknowns, len(problem.unknowns.parameters)
    shared = tuple(
        replace(s, scale=s.scale * factor) if first + k in places else s for k, s in enumerate(unknowns.shared)
    )
    return replace(problem, unknowns=replace(unknowns, shared=shared))


def face_findings(c: Calibration) -> Iterator[Finding]:
    """Faces whose offsets their tolerance does not explain, and a jig that is worse than stated as a whole."""
    faces = {} if c.cell.jig is None else c.cell.jig.by_name
    places = [k for k, shared in enumerate(c.shared) if shared.name.removeprefix(FACE) in faces]
    if not places:
        return
    names = [c.shared[k].name.removeprefix(FACE) for k in places]
    stated = np.array([faces[name].tolerance for name in names])
    ratio = np.array([c.shared[k].scale for k in places]) / stated
    first = len(c.estimated)
    deviation = np.sqrt(np.diag(c.joint_covariance))[first:][places]
    value = np.array([c.shared[k].value for k in places])
    if (ratio > 1.5).any():
        yield Finding(
            "jig",
            f"the touches fit a jig whose faces are off by {(ratio * stated).max():.3f} mm (1 sigma), "
            f"{ratio.max():.1f} times the stated tolerance; measure the jig, or write a wider tolerance_mm",
        )
    scatter = np.sqrt(np.maximum((ratio * stated) ** 2 - deviation**2, 1e-12)) / np.maximum(ratio, 1.0)
    beyond = np.maximum(stated, INTERVAL * deviation)
    for k in np.flatnonzero((np.abs(value) > NAMED * np.maximum(scatter, 0.2 * stated)) & (np.abs(value) > beyond)):
        yield Finding(
            "face",
            f"'{names[k]}' stands {value[k]:+.3f} +- {INTERVAL * deviation[k]:.3f} mm (95 %) off its place, stated "
            f"{stated[k]:g} mm (1 sigma); measure it, or correct the jig file",
        )
