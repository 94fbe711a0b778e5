"""Touches near an edge: the next face may have stopped the wire, and a touch that nobody can place counts nothing.

A controller reports a contact, not a face. A fit to few touches can bend the robot until a contact with the next face
lies on the planned one. So each touch is judged by the estimate from all others: it may have met any face beside which
that estimate puts the tip, and the odds of the faces are those of their residuals.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from identify.estimation.problem import CalibrationFailed, Problem
from identify.estimation.robust import Estimate, estimate
from identify.model.touch import Touches

NEAR = 20.0  # [mm] from its plane, beyond which no touch met a face
BESIDE = 2.0  # [mm], by which a contact may lie beside its face
RARE = 3.0  # logarithm of the odds by which the planned face is met rather than another
CERTAIN = 5.0  # logarithm of the odds that place a touch on the planned face
GRAZING = 0.05  # largest cosine between a search and the normal of a face that it may meet: a robot may be off
ROUNDS = 6


def without_doubtful(problem: Problem, fit: Estimate, touches: Touches | None) -> tuple[Problem, Estimate]:
    """The problem and the estimate in which touches that may have met another face count nothing (sigma infinite).

    Without the table of touches nothing changes. After ROUNDS every touch that was doubtful once stays out.
    """
    if touches is None or problem.cell.jig is None:
        return problem, fit
    stated, before = problem.rows, list[Bool[np.ndarray, " rows"]]()
    for number in range(ROUNDS):
        doubtful = doubts(problem, fit, touches, stated.sigma) < CERTAIN
        if number == ROUNDS - 1:
            doubtful = np.logical_or.reduce([doubtful, *before])
        if np.array_equal(doubtful, before[-1] if before else np.zeros(len(doubtful), dtype=bool)):
            break
        before.append(doubtful)
        reduced = replace(problem, rows=replace(stated, sigma=np.where(doubtful, np.inf, stated.sigma)))
        try:
            problem, fit = reduced, estimate(reduced, problem.theta(fit.x), fit.used & ~doubtful)
        except CalibrationFailed:
            break
    return problem, fit


def doubts(
    problem: Problem, fit: Estimate, touches: Touches, sigma: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, " rows"]:
    """Logarithm of the odds of the face of each touch against the most probable other one; infinite far from others.

    Residuals and their variances are those that the estimate from all other touches predicts. With the weight w of a
    row a, its leverage h = w^2 a'Ca and its residual r, the others put the coordinates C a w^2 r / (1 - h) farther, and
    their covariance is C + w^2 C a a'C / (1 - h).
    """
    rows, noise = problem.rows, max(fit.noise, 1.0)
    touch, face = _pairs(problem, fit, touches)
    odds = np.full(len(rows), np.inf)
    if not len(touch):
        return odds
    C, own = problem.covariance(fit.x, fit.weight), fit.weight**2
    A = np.concatenate([J for _, _, J in problem.linearized(fit.x)])
    r = problem.residual(fit.x)
    CA = A @ C
    rest = np.clip(1 - own * (CA * A).sum(axis=1), 1e-6, 1.0)
    faces = problem.cell.the_jig.faces
    other = replace(
        rows.take(touch),
        face=tuple(faces[k].name for k in face),
        normal=np.stack([faces[k].normal for k in face]),
        offset=np.array([faces[k].offset for k in face]) + problem.cell.wire.ball,
        sigma=sigma[touch],
    )
    away, J = problem.unknowns.linearize(problem.unknown(fit.x), other)
    B = J @ problem.basis
    across = (B * CA[touch]).sum(axis=1)
    away = away + across * (own * r / rest)[touch]
    noise2 = (noise * sigma) ** 2
    spread = noise2[touch] + ((B @ C) * B).sum(axis=1) + across**2 * (own / rest)[touch]
    density = _log_density(r / rest, noise2 + (CA * A).sum(axis=1) / rest)
    np.minimum.at(odds, touch, density[touch] + RARE - _log_density(away, spread))
    return odds


def _log_density(r: Float[np.ndarray, " rows"], variance: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    return -0.5 * r * r / variance - 0.5 * np.log(variance)


def _pairs(
    problem: Problem, fit: Estimate, touches: Touches
) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
    """Touches, and other faces that each of them may have met: near, not beside them, and not looked at from behind."""
    cell, rows = problem.cell, problem.rows
    theta = problem.theta(fit.x)
    tip = cell.kinematics.tip(rows.q, theta)[0]
    step = np.zeros_like(tip)
    if touches.approach is not None:
        step = tip - cell.kinematics.tip(touches.approach, theta)[0]
        step = np.nan_to_num(step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9))
    possible = np.zeros((len(rows), len(cell.the_jig.faces)), dtype=bool)
    for k, face in enumerate(cell.the_jig.faces):
        near = np.abs(tip @ face.normal - face.offset) < NEAR
        possible[:, k] = near & (face.beside(tip) < BESIDE) & (step @ face.normal < GRAZING) & ~rows.on(face.name)
    touch, other = np.nonzero(possible)
    return touch, other
