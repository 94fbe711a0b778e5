"""Faces that stand elsewhere than the jig file says, and a jig that is worse than its tolerance."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from identify.estimation.all_joint_errors import shown, whitened
from identify.estimation.discrepancy import CERTAIN, ENOUGH, ERROR, LOOSE, Linear
from identify.estimation.problem import Problem
from identify.estimation.robust import Estimate, estimate
from identify.estimation.selection import FREE, extend
from identify.model.calibration import FACE, Calibration, Finding
from identify.uncertainty.promise import INTERVAL

WIDE = 5.0  # times its tolerances that a jig may be off, for the fit that shows how far it is
FACTORS = np.array([1.0, *(2 * 1.25 ** np.arange(7))])  # times its tolerances that a jig may be off
JOINT_ERRORS = np.array([0.0, 0.03, 0.1, 0.3, 1.0, 3.0])  # times their priors, each as probable as the others
NOISES = 1.25 ** np.arange(-4, 7)  # times the stated sigma
LEAST = 3.0  # offsets that touches show: fewer tell of no scale
SOUND = 0.55  # probability of a jig as good as stated, before it is touched
BELIEVED = 0.5  # and of one that is not called worse, afterwards
NAMED = 4.0  # standard deviations that the tolerance does not explain


def with_jig_as_it_is(problem: Problem, fit: Estimate) -> tuple[Problem, Estimate]:
    """The problem with the tolerances of all faces as wide as the touches show them to be, and its estimate.

    The rows are taken at a fit that hardly holds the faces: one that holds them as stated would take their offsets for
    noise. A jig is called worse only where joint errors do not explain the same residuals, and where the touches show
    the offsets of several faces: those that base and tool make up for show nothing.
    """
    places = _places(problem)
    if not len(places):
        return problem, fit
    wide = _scaled(problem, places, WIDE)
    end = estimate(wide, problem.theta(fit.x), fit.used)
    covariance = wide.of_unknowns(wide.covariance(end.x, end.weight))
    if len(places) - covariance[places, places].sum() < LEAST:
        return problem, fit
    rows = np.flatnonzero(fit.used)
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), ENOUGH)).astype(int)]
    for errors in ((), shown(problem.cell, problem.rows)):
        extended = extend(wide, end.x, errors)
        faces = np.isin(extended.unknowns.names, [problem.unknowns.names[i] for i in places])
        probability = probabilities(whitened(extended).take(rows), np.where(faces, 1 / WIDE, 0.0))
        if probability[0] > BELIEVED:
            return problem, fit
    factor = float(np.sqrt(probability[1:] @ FACTORS[1:] ** 2 / probability[1:].sum()))
    scaled = _scaled(problem, places, factor)
    return scaled, estimate(scaled, problem.theta(fit.x), fit.used)


def probabilities(rows: Linear, stated: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " factors"]:
    """Probability of each of FACTORS on the tolerances of faces, by marginal likelihood (MacKay 1992).

    `stated` are the tolerances in units of the priors of the rows, 0 for unknowns that are no offset of a face. The
    sizes of the joint errors and of the noise are averaged over. With the covariance S of the rows without faces, faces
    B and a factor f, y has the covariance S + f^2 B B', of which the determinant lemma and the Woodbury identity need
    no more than the eigenvalues of B' S^-1 B.
    """
    (R, z), count = _compressed(rows.A * np.where(rows.kind == LOOSE, FREE, 1.0), rows.y), len(rows.y)
    face, error = stated > 0, rows.kind == ERROR
    B, E, G = R[:, face] * stated[face], R[:, error], R[:, ~face & ~error]
    rest = float(rows.y @ rows.y - z @ z)
    noise2 = NOISES[:, None] ** 2
    usual = -CERTAIN * np.log(NOISES) - CERTAIN / 2 / NOISES**2  # chi-square, as in `discrepancy`
    logs = []
    for size in JOINT_ERRORS if error.any() else JOINT_ERRORS[:1]:
        value, vector = np.linalg.eigh(G @ G.T + size**2 * E @ E.T)
        variance = np.maximum(value, 0.0) + noise2
        b, y = (vector.T @ B) / np.sqrt(variance)[:, :, None], (vector.T @ z) / np.sqrt(variance)
        gain, axes = np.linalg.eigh(b.transpose(0, 2, 1) @ b)
        gain = 1 + FACTORS[:, None, None] ** 2 * np.maximum(gain, 0.0)
        part = FACTORS[:, None, None] * np.einsum("nij,nki,nk->nj", axes, b, y, optimize=True)
        square = (y * y).sum(axis=1) + rest / noise2[:, 0] - (part**2 / gain).sum(axis=2)
        determinant = np.log(variance).sum(axis=1) + np.log(gain).sum(axis=2)
        logs.append(usual - 0.5 * (determinant + square) - (count - len(z)) * np.log(NOISES))
    weight = np.exp(np.array(logs) - np.max(logs)).sum(axis=(0, 2))
    weight *= np.where(FACTORS == 1, SOUND, (1 - SOUND) / (len(FACTORS) - 1))
    return np.asarray(weight / weight.sum())


def _compressed(A: Float[np.ndarray, "rows unknowns"], y: Float[np.ndarray, " rows"]) -> tuple[np.ndarray, np.ndarray]:
    """Fewer rows that say as much of the unknowns, where there are more rows than unknowns."""
    if len(A) <= A.shape[1]:
        return A, y
    Q, R = np.linalg.qr(A)
    return R, Q.T @ y


def _places(problem: Problem) -> Int[np.ndarray, " faces"]:
    """Places of the offsets of touched faces among the unknowns."""
    touched = {FACE + name for name in problem.rows.face}
    return np.array([i for i, name in enumerate(problem.unknowns.names) if name in touched], dtype=int)


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
