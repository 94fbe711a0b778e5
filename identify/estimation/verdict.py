"""Whether a calibration may be used: if not, what is wrong and what to do."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from identify.estimation.problem import Problem
from identify.model.calibration import Calibration, Finding, summarize
from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.measurement import Measured, Rows, equations
from identify.model.zone import zone_poses
from identify.uncertainty.promise import TipErrors, promise

ABSURD = 20.0  # times its sigma that no measurement scatters
MOST = 0.25  # share of the measurements that may be left out
OPEN = 100.0  # times the sigma of a touch that a promise may be
STEPS = 25  # of a fit to a hypothesis
BETTER = 0.1  # of the residuals that a hypothesis may leave, to be proposed


def promised(c: Calibration) -> dict[str, float] | None:
    """The promise of a calibration in its weld zone [mm]; None for a cell without zone and jig.

    What the measurements scatter beyond their stated sigma may be the robot's, so it is part of the tip error.
    """
    if c.cell.zone is None and c.cell.jig is None:
        return None
    q = zone_poses(c.cell, c.theta)
    value, vector = np.linalg.eigh(c.covariance)
    J = c.cell.kinematics.tip_jacobian(q, c.theta)[1][:, :, c.index]
    excess = c.cell.touch.sigma * np.sqrt(max(c.noise**2 - 1.0, 0.0))
    own = np.broadcast_to(excess * np.eye(3), (len(q), 3, 3))
    root = np.concatenate([(J @ vector) * np.sqrt(np.maximum(value, 0.0)), own], axis=2)
    found = promise(TipErrors(root))
    return {"rms_mm": found.rms_mm, "p95_mm": found.p95_mm}


def refusals(c: Calibration) -> tuple[str, ...]:
    """Reasons for which a calibration must not be used, each with what to do; none if it may be."""
    return tuple(_refusals(c))


def _refusals(c: Calibration) -> Iterator[str]:
    before = summarize(np.array([r.before_mm for r in c.residuals.values() if r.used] or [0.0]))
    sigma, worse = c.cell.touch.sigma, c.held_out if c.held_out is not None else c.fit
    if worse.rms_mm > before.rms_mm and worse.rms_mm > 2 * sigma:
        yield (
            f"the identified robot is worse than the drawing: RMS {worse.rms_mm:.3g} mm, before {before.rms_mm:.3g} mm;"
            " check joint signs and zeros, units and face names, or measure more poses"
        )
    if c.scatter > ABSURD:
        yield (
            f"the measurements scatter {c.scatter:.0f} times their stated sigma around the best fit, RMS "
            f"{c.fit.rms_mm:.3g} mm: a joint may count the other way or from another zero, a column may be in other "
            "units, or one file may hold several targets; check them with touchcal check"
        )
    share = len(c.outliers) / max(len(c.residuals), 1)
    if share > MOST:
        yield (
            f"{len(c.outliers)} of {len(c.residuals)} measurements disagree with the others ({100 * share:.0f} %): "
            "check face names, the jig and the base in cell.yaml, then touch again"
        )
    if c.promise is not None and not c.promise["p95_mm"] < OPEN * sigma:
        yield (
            f"the zone is not determined: the tip may be {c.promise['p95_mm']:.3g} mm off at 95 % of its poses; "
            "make more touches, on other faces and with other wrist angles"
        )


def hypotheses(cell: Cell, measured: Sequence[Measured]) -> tuple[Finding, ...]:
    """What would explain measurements that no robot near the drawing fits: a sign, a zero, a unit.

    Each is tried by a fit of its own, and proposed if it leaves a tenth of the residuals.
    """
    recorded = equations(cell, measured)
    _, before = _fit(cell, recorded)
    ends = [(*_fit(cell, changed), finding) for changed, finding in _changed(cell, recorded)]
    _, rms, (kind, what, cure) = min(ends, key=lambda end: end[0])
    if not rms < BETTER * before:
        return ()
    fall = f"fall from {before:.3g}" if np.isfinite(before) else "fall"
    return (Finding(kind, f"{what}: the residuals {fall} to {rms:.3g} mm RMS; {cure}"),)


def _changed(cell: Cell, recorded: Rows) -> Iterator[tuple[Rows, tuple[str, str, str]]]:
    """Rows as they would be by each hypothesis: its kind, what it says, and its cure."""
    for i, joint in enumerate(cell.robot.joints):
        turned = recorded.q * np.where(np.arange(recorded.q.shape[1]) == i, -1.0, 1.0)
        yield (
            replace(recorded, q=turned),
            (
                "joint sign",
                f"joint {joint.name} seems to count the other way",
                f"write joints: {{sign: {{{joint.name}: -1}}}} into cell.yaml",
            ),
        )
        for degrees in () if joint.prismatic else (-90, 90, 180):
            shifted = recorded.q + np.radians(degrees) * (np.arange(recorded.q.shape[1]) == i)
            yield (
                replace(recorded, q=shifted),
                (
                    "joint zero",
                    f"joint {joint.name} seems to count from a zero {degrees} degrees off",
                    f"write joints: {{zero_deg: {{{joint.name}: {degrees}}}}} into cell.yaml",
                ),
            )
    axes = np.argmax(np.abs(recorded.normal), axis=1)
    if not any(recorded.face) and (np.abs(recorded.normal).max(axis=1) > 1 - 1e-12).all():
        for k, name in enumerate("xyz"):
            scaled = np.where(axes == k, 1000.0, 1.0) * recorded.offset
            yield (
                replace(recorded, offset=scaled),
                ("unit", f"column {name}_mm seems to hold metres", "write millimetres into it"),
            )


def _fit(cell: Cell, recorded: Rows) -> tuple[float, float]:
    """Objective, priors included, and RMS [mm] of the better three quarters, after some Levenberg-Marquardt steps."""
    try:
        problem = Problem.pose(cell, recorded, "linear", True, eliminate=False)
    except (InputError, np.linalg.LinAlgError):
        return np.inf, np.inf
    x, damping = np.zeros(problem.size), 1.0
    value, gradient, hessian = problem.objective.at(x)
    for _ in range(STEPS):
        step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian) + 1e-12), -gradient)
        there = problem.objective.at(x + step)
        if there[0] < value:
            x, damping = x + step, damping / 5
            value, gradient, hessian = there
        else:
            damping *= 5
    r = np.sort(np.abs(problem.residual(x)))
    return value, float(np.sqrt(np.mean(r[: max(3 * len(r) // 4, 1)] ** 2)))
