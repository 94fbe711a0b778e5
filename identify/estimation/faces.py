"""Faces that stand elsewhere than the jig file says, and a jig that is worse than its tolerance."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.special import chdtrc

from identify.estimation.problem import Problem
from identify.estimation.robust import Estimate, estimate
from identify.model.calibration import FACE, Calibration, Finding
from identify.uncertainty.promise import INTERVAL

CHANCE = 0.02  # of a jig as good as stated to be called worse
CERTAIN = 1.0  # degrees of freedom that the stated tolerances are worth
STEPS = 10  # of expectation and maximization
NAMED = 4.0  # standard deviations that the tolerance does not explain


def with_jig_as_it_is(problem: Problem, fit: Estimate) -> tuple[Problem, Estimate]:
    """The problem with the tolerances of all faces as wide as the touches show them to be, and its estimate.

    A test of the estimated offsets decides whether the jig is worse than stated; expectation and maximization finds by
    how much.
    """
    places = _places(problem)
    if not len(places) or surprise(*_offsets(problem, fit, places)) > CHANCE:
        return problem, fit
    stated, factor = problem, 1.0
    for _ in range(STEPS):
        b, C = _offsets(problem, fit, places)
        square = (b * b + np.diag(C)).sum() * factor**2  # in units of the stated tolerances
        before, factor = factor, float(np.sqrt((CERTAIN + square) / (CERTAIN + len(b))))
        problem = _scaled(stated, places, max(factor, 1.0))
        fit = estimate(problem, problem.theta(np.zeros(problem.size)))
        if abs(factor - before) < 0.02 * before:
            break
    return problem, fit


def surprise(b: Float[np.ndarray, " faces"], C: Float[np.ndarray, "faces faces"]) -> float:
    """Chance of estimated offsets so large for a jig as good as stated (chi-square).

    b are the estimates and C their posterior covariance, in units of the tolerances: estimates scatter by 1 - C.
    """
    value, vector = np.linalg.eigh(np.eye(len(b)) - C)
    visible = value > 0.05
    if not visible.any():
        return 1.0
    return float(chdtrc(visible.sum(), (((vector.T @ b)[visible]) ** 2 / value[visible]).sum()))


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
            f"its faces stand {np.sqrt(np.mean(value**2)):.3f} mm (RMS) off their places, {ratio.max():.1f} times "
            "their tolerance; measure the jig, or write a wider tolerance_mm",
        )
    scatter = np.sqrt(np.maximum((ratio * stated) ** 2 - deviation**2, 1e-12)) / np.maximum(ratio, 1.0)
    beyond = np.maximum(stated, INTERVAL * deviation)
    for k in np.flatnonzero((np.abs(value) > NAMED * np.maximum(scatter, 0.2 * stated)) & (np.abs(value) > beyond)):
        yield Finding(
            "face",
            f"'{names[k]}' stands {value[k]:+.3f} +- {INTERVAL * deviation[k]:.3f} mm (95 %) off its place, stated "
            f"{stated[k]:g} mm (1 sigma); measure it, or correct the jig file",
        )
