"""Starts that survive gross errors and wrong face names: trimmed fits, and hypotheses on which face a touch met."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from identify.estimation.face_association import believe
from identify.estimation.problem import CalibrationFailed, Problem
from identify.estimation.robust import CAP, Estimate, cost, estimate
from identify.model.cell import Cell
from identify.model.measurement import Measurements, Rows, equations
from identify.model.touch import Touches

SUSPECT = 2.0  # times its sigma that a fit scatters, from which other starts are tried
DOUBTED = 0.1  # share of the rows left out from which they are tried
SUBSETS = 200  # random subsets of the measurements to begin a trimmed fit from
FIRST, BEST = 2, 10  # steps of all of them, and how many of them go on, as the authors do
CONCENTRATIONS = 8  # steps of those: fit to the best of the measurements, find the best of the measurements
TRIMMED = 0.75  # share of the measurements that a trimmed fit rests on
REST = 2.0  # [mm], by which a contact may lie beside its face, beside three standard deviations
ASIDE = 10.0  # [mm] beside its face, from which a contact was with another one in the same plane
SURE = 5.0  # standard deviations within which a touch lies on another face
MANY = 2000  # rows from which all fits rest on so many that trimmed fits are not worth their time


@dataclass(frozen=True, eq=False)
class Label:
    """A touch whose face was another than its name says."""

    touch: str
    face: str
    recorded: str
    off: float  # [mm], of its tip from the face that was recorded


def survivor(problem: Problem, fit: Estimate, tables: tuple[Measurements, ...]) -> tuple[Problem, Estimate]:
    """The estimate with the fewest and smallest contradictions among those from several starts.

    A plain robust fit can be drawn away by a fifth of gross errors. If its residuals scatter far more than stated, a
    least trimmed squares fit (FAST-LTS, Rousseeuw and Van Driessen 2006) and the association of touches with faces are
    tried. The one whose capped squares, priors included, are least is returned.
    """
    if problem.loss == "linear" or len(problem.rows) > MANY:
        return problem, fit
    ends = [(problem, fit)]
    if fit.noise > SUSPECT or (~fit.used).mean() > DOUBTED:
        ends += _grown(problem, problem.theta(fit.x), trimmed(problem, fit.x))
        ends += _associated(problem, tables)
        ends = [min(ends, key=lambda end: cost(*end))]
    return min([*ends, *_renamed(*ends[0], tables)], key=lambda end: cost(*end) + CAP * float(aside(*end).sum()))


def trimmed(problem: Problem, x: Float[np.ndarray, " size"]) -> Bool[np.ndarray, " rows"]:
    """Rows of the measurements that agree with a least trimmed squares fit, linear about x."""
    parts = list(problem.linearized(x))
    sigma, owner = problem.rows.sigma, problem.rows.owner
    A = np.concatenate([J for _, _, J in parts]) / sigma[:, None]
    y = A @ x - np.concatenate([r for _, r, _ in parts]) / sigma
    precision = np.diag(1 / problem.prior**2) + 1e-9 * np.eye(len(x))
    rng, count = np.random.default_rng(0), len(problem.rows.ids)
    subsets = rng.random((SUBSETS, count)) < TRIMMED
    most = max(int(TRIMMED * count), 1)
    for step in range(CONCENTRATIONS):
        w = subsets[:, owner].astype(float)
        G = np.einsum("sm,mi,mj->sij", w, A, A, optimize=True) + precision
        solution = np.linalg.solve(G, (w @ (A * y[:, None]))[..., None])[..., 0]
        square = np.zeros(subsets.shape)
        np.add.at(square.T, owner, ((y - solution @ A.T) ** 2).T)
        worst = np.partition(square, most - 1, axis=1)[:, most - 1 : most]
        subsets = square <= worst
        costs = np.minimum(square, CAP).sum(axis=1) + ((solution / problem.prior) ** 2).sum(axis=1)
        if step == FIRST - 1:
            subsets = subsets[np.argsort(costs)[:BEST]]
    return subsets[int(np.argmin(costs))][owner]


def _associated(problem: Problem, tables: tuple[Measurements, ...]) -> Iterator[tuple[Problem, Estimate]]:
    """The estimate from where touches are associated with faces, if all that was measured are touches on faces."""
    cell = problem.cell
    touches = on_faces(tables)
    if touches is None or cell.base is None or cell.tool is None:
        return
    belief = believe(cell, touches)
    pairs = zip(belief.touches.face, belief.used, problem.rows.face, strict=True)
    again = relabelled(
        problem, tables, tuple(met if use and met in cell.the_jig.by_name else face for met, use, face in pairs)
    )
    yield from _grown(again, belief.theta, belief.used[again.rows.owner])


def _renamed(problem: Problem, fit: Estimate, tables: tuple[Measurements, ...]) -> Iterator[tuple[Problem, Estimate]]:
    """The estimate with touches that were left out, or lie beside their faces, on those that they most probably met."""
    if on_faces(tables) is not None:
        again = relabelled(problem, tables, nearest(problem, fit))
        if again is not problem:
            elsewhere = np.array([a != b for a, b in zip(again.rows.face, problem.rows.face, strict=True)])
            yield from _grown(again, problem.theta(fit.x), fit.used | elsewhere)


def _grown(
    problem: Problem, theta: Float[np.ndarray, " parameters"], inliers: Bool[np.ndarray, " rows"]
) -> Iterator[tuple[Problem, Estimate]]:
    """The estimate from a start with rows that agree, if the solver converges from there."""
    with suppress(CalibrationFailed):
        yield problem, estimate(problem, theta, inliers)


def on_faces(tables: tuple[Measurements, ...]) -> Touches | None:
    """The touches, if all that was measured is one table of touches, each on a face with a name."""
    if len(tables) == 1 and isinstance(tables[0], Touches) and all(tables[0].face):
        return tables[0]
    return None


def relabelled(problem: Problem, tables: tuple[Measurements, ...], faces: tuple[str, ...]) -> Problem:
    """The problem with the touches of a table on other faces."""
    if faces == problem.rows.face:
        return problem
    (touches,), by_name, cell = tables, problem.cell.the_jig.by_name, problem.cell
    changed = np.array([face != name for face, name in zip(faces, touches.face, strict=True)])  # type: ignore[union-attr]
    normal, offset = touches.normal.copy(), touches.offset.copy()  # type: ignore[union-attr]
    for i in np.flatnonzero(changed):
        normal[i], offset[i] = by_name[faces[i]].normal, by_name[faces[i]].offset
    met = replace(touches, face=faces, normal=normal, offset=offset)  # type: ignore[arg-type]
    return replace(problem, rows=equations(cell, [met]))


def labels(problem: Problem, fit: Estimate, recorded: Rows) -> tuple[Label, ...]:
    """Touches that met another face than was recorded, by an estimate whose rows may bear other faces already."""
    if not problem.rows.face or problem.rows.face == recorded.face:
        return ()
    off = problem.unknowns.linearize(problem.unknown(fit.x), recorded)[0]
    tip = problem.cell.kinematics.tip(problem.rows.q, problem.theta(fit.x))[0]
    by_name = problem.cell.the_jig.by_name
    return tuple(
        Label(problem.rows.ids[owner], name, before, float(np.hypot(off[i], by_name[before].beside(tip[i]))))
        for i, (owner, name, before) in enumerate(
            zip(problem.rows.owner, problem.rows.face, recorded.face, strict=True)
        )
        if name != before
    )


def nearest(problem: Problem, fit: Estimate) -> tuple[str, ...]:
    """Faces of touches; those left out, or aside, on the nearest face, if it is as near as a touch on it would be."""
    by_name, faces = problem.cell.the_jig.by_name, list(problem.rows.face)
    tip = problem.cell.kinematics.tip(problem.rows.q, problem.theta(fit.x))[0]
    for i in np.flatnonzero(~fit.used | aside(problem, fit)):
        off = _distances(problem.cell, tip[i])
        name = min(off, key=lambda face: abs(off[face]), default="")
        own = SURE * max(fit.noise * problem.rows.sigma[i], by_name[name].tolerance) if name else 0.0
        if name and abs(off[name]) < own + problem.cell.wire.flat:
            faces[i] = name
    return tuple(faces)


def aside(problem: Problem, fit: Estimate) -> Bool[np.ndarray, " rows"]:
    """Touches in use whose tip lies in the plane of their face, but beside it."""
    rows, out = problem.rows, np.zeros(len(problem.rows), dtype=bool)
    tip = problem.cell.kinematics.tip(rows.q, problem.theta(fit.x))[0]
    for face in () if problem.cell.jig is None else problem.cell.jig.faces:
        on = rows.on(face.name) & (np.abs(rows.offset - face.offset - problem.cell.wire.ball) < 1e-6)
        out[on] = face.beside(tip[on]) > ASIDE
    return out & fit.used


def _distances(cell: Cell, tip: Float[np.ndarray, " 3"]) -> dict[str, float]:
    """Distances [mm] of a tip from the faces that it may have met: those beside which it does not lie."""
    near = dict[str, float]()
    for face in cell.the_jig.faces:
        if face.beside(tip) < REST:
            near[face.name] = float(face.normal @ tip - face.offset - cell.wire.ball)
    return near
