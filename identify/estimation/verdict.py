"""Whether a calibration may be used: if not, what is wrong and what to do."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product

import numpy as np

from identify.estimation.problem import Problem
from identify.model.calibration import Calibration, Finding, summarize
from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.measurement import Measurements, Rows, equations
from identify.uncertainty.posterior import zone_promise

ABSURD = 20.0  # times its sigma that no measurement scatters
MOST = 0.25  # share of the measurements that may be left out
OPEN = 100.0  # times the sigma of a touch that a promise may be
FRAME = {"base.x", "base.y", "base.z"}  # as little known as before where nothing ties the jig frame to measurements
STEPS = 25  # of a fit to a hypothesis
QUARTERS = -90, 90, 180  # [deg], zeros that are tried
BETTER = 0.1  # of the residuals that a hypothesis may leave, to be proposed


def with_promise(c: Calibration) -> Calibration:
    """The calibration with its promise for the weld zone; as it is for a cell without zone and jig."""
    if c.cell.zone is None and c.cell.jig is None:
        return c
    return replace(c, promise=asdict(zone_promise(c)))


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
        cure = "make more touches, on other faces and with other wrist angles"
        if _frame_is_open(c):
            cure = (
                "nothing that was measured tells where the base stands in the jig frame. Give the places of three "
                "points, or of a placement; or let the base define the frame: base_mm: 0.01, base_deg: 0.001 in priors"
            )
        yield (
            f"the zone is not determined: the tip may be {c.promise['p95_mm']:.3g} mm off at 95 % of its poses; {cure}"
        )


def _frame_is_open(c: Calibration) -> bool:
    """Whether the jig frame hangs on the tolerances of the base alone: points and placements were fitted."""
    fitted = any(shared.name.startswith(("point.", "placement.")) for shared in c.shared)
    return fitted and set(c.weak) >= FRAME and c.cell.priors.base[0] > c.cell.touch.sigma


def hypotheses(cell: Cell, tables: Sequence[Measurements]) -> tuple[Finding, ...]:
    """What would explain measurements that no robot near the drawing fits: a sign, a zero, a unit.

    Each is tried by a fit of its own, and proposed if it leaves a tenth of the residuals. Zeros that are off by less
    than a quarter turn are estimated as they are.
    """
    recorded = equations(cell, tables)
    posed = _posed(cell, recorded)
    before = _fit(cell, recorded, posed)[1]

    def tried(some: Iterable[_Changed]) -> list[tuple[float, float, _Changed]]:
        return [(*_fit(cell, changed.rows, posed), changed) for changed in some]

    ends = tried((*_signs(cell, recorded), *_zeros(cell, recorded), *_units(recorded)))
    _, rms, changed = min(ends, key=lambda end: end[0])
    if not rms < BETTER * before:
        return ()
    fall = f"fall from {before:.3g}" if np.isfinite(before) else "fall"
    return (Finding(changed.kind, f"{changed.words}: the residuals {fall} to {rms:.3g} mm RMS; {changed.cure}"),)


@dataclass(frozen=True, eq=False)
class _Changed:
    """Rows as they would be by a hypothesis, what it says, and its cure."""

    rows: Rows
    kind: str
    words: str
    cure: str


def _signs(cell: Cell, recorded: Rows) -> Iterator[_Changed]:
    """One joint counts the other way."""
    for i, joint in enumerate(cell.robot.joints):
        turned = recorded.q * np.where(np.arange(recorded.q.shape[1]) == i, -1.0, 1.0)
        words = f"joint {joint.name} seems to count the other way"
        cure = f"write joints: {{sign: {{{joint.name}: -1}}}} into cell.yaml"
        yield _Changed(replace(recorded, q=turned), "joint sign", words, cure)


def _zeros(cell: Cell, recorded: Rows) -> Iterator[_Changed]:
    """One turning joint counts from another zero."""
    joints = [(i, joint) for i, joint in enumerate(cell.robot.joints) if not joint.prismatic]
    for (i, joint), off in product(joints, QUARTERS):
        shifted = recorded.q + np.radians(off) * (np.arange(recorded.q.shape[1]) == i)
        words = f"joint {joint.name} seems to count from a zero {off} degrees off"
        cure = f"write joints: {{zero_deg: {{{joint.name}: {off}}}}} into cell.yaml"
        yield _Changed(replace(recorded, q=shifted), "joint zero", words, cure)


def _units(recorded: Rows) -> Iterator[_Changed]:
    """One column of positions holds metres."""
    axes = np.argmax(np.abs(recorded.normal), axis=1)
    if not any(recorded.face) and (np.abs(recorded.normal).max(axis=1) > 1 - 1e-12).all():
        for k, name in enumerate("xyz"):
            scaled = replace(recorded, offset=np.where(axes == k, 1000.0, 1.0) * recorded.offset)
            yield _Changed(scaled, "unit", f"column {name}_mm seems to hold metres", "write millimetres into it")


def _posed(cell: Cell, recorded: Rows) -> Problem | None:
    """The problem of all unknowns; None if there is none."""
    try:
        return Problem.pose(cell, recorded, "linear", True, eliminate=False)
    except (InputError, np.linalg.LinAlgError):
        return None


def _fit(cell: Cell, recorded: Rows, posed: Problem | None) -> tuple[float, float]:
    """Objective, priors included, and RMS [mm] of the better three quarters, after some Levenberg-Marquardt steps.

    A base or a tool that is to be fitted starts where these rows put it; else the unknowns are those of the problem.
    """
    open_pose = posed is None or cell.base is None or cell.tool is None
    problem = _posed(cell, recorded) if open_pose else replace(posed, rows=recorded)  # type: ignore[type-var]
    if problem is None:
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
