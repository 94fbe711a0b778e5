"""What a fit gives away: base or tool far off, joints read too early, one bad joint, touches that were left out."""

from collections.abc import Iterator, Sequence

import numpy as np

from identify.estimation.changes import Case, Residuals, certainty
from identify.estimation.faces import face_findings
from identify.estimation.problem import Problem
from identify.estimation.robust import Estimate
from identify.model.calibration import Calibration, Finding
from identify.model.frames import inverse, transform
from identify.model.measurement import Measurements
from identify.model.touch import Positions

SHARE = 0.2  # of the residuals' squares that one joint explains, to be called bad
TWICE = 2.0  # as much as any other joint does
FAR = 6.0  # times its tolerance that a base or a tool may be off


def diagnose(problem: Problem, estimate: Estimate, tables: Sequence[Measurements]) -> tuple[Finding, ...]:
    """What is wrong with touches or robot, as far as residuals tell."""
    case = Case(problem, estimate, tables)
    return (*_unsettled(case), *_joint(case, case.residuals(estimate.used)), *_outliers(case))


def place_findings(c: Calibration) -> tuple[Finding, ...]:
    """A base or a tool far off; where both are sound, faces and a jig that are: a wrong frame accuses faces."""
    return tuple(frame_findings(c)) or tuple(face_findings(c))


def frame_findings(c: Calibration) -> Iterator[Finding]:
    """A base or a tool that is identified many times its tolerance off what the cell file says."""
    frames = (
        ("base", c.cell.base, c.theta[:6], c.cell.priors.base),
        ("tool", c.cell.tool, c.theta[-6:], c.cell.priors.tool),
    )
    for name, stated, identified, (length, angle) in frames:
        if stated is None:
            continue
        apart = inverse(transform(stated)) @ transform(identified)
        shift = float(np.linalg.norm(apart[:3, 3]))
        turn = float(np.arccos(np.clip((np.trace(apart) - 2) / 2, -1, 1)))
        times = max(shift / length, turn / angle)
        if times > FAR:
            yield Finding(
                name,
                f"the touches put the {name} {shift:.1f} mm and {np.degrees(turn):.1f} degrees from where the cell "
                f"file has it, {times:.0f} times its tolerance ({name}_mm: {length:g}, "
                f"{name}_deg: {np.degrees(angle):g}); look at {name} of the cell file, correct it, then identify again",
            )


def _unsettled(case: Case) -> Iterator[Finding]:
    """Joints read before they stood: they lag on the way from the measurement before."""
    if not all(isinstance(table, Positions) for table in case.tables):
        return
    stands = case.rows.q[case.first]
    step = np.diff(stands, axis=0, prepend=stands[:1])
    ways = case.lever * step[case.order]
    residuals = case.residuals(np.ones(len(case.rows), dtype=bool)).without(case.lever * case.rows.q)  # gears
    lag, sure = residuals.amount(ways.sum(axis=1))
    if -sure < certainty():
        return
    still_to_go = np.abs(lag * step / case.robot.joint_unit())
    yield Finding(
        "joints read too early",
        f"the arm was on {-100 * lag:.3f} % of the way from the position before when its joints were read, up to "
        f"{still_to_go.max():.3f} deg ({-sure:.0f} standard deviations): wait until it stands, or use the commanded "
        "joint values",
    )


def _joint(case: Case, residuals: Residuals) -> Iterator[Finding]:
    """One joint that turns unevenly, far more than all others."""
    total = float(residuals.r @ residuals.r)
    q = case.rows.q / np.where(case.robot.prismatic, 100.0, 1.0)
    shapes = np.stack([q, np.cos(q), np.sin(q), np.cos(2 * q), np.sin(2 * q)], axis=2)
    gains = residuals.explained_by_each((case.lever[:, :, None] * shapes).transpose(1, 0, 2))
    best = int(np.argmax([gain for gain, _ in gains]))
    (gain, count), others = gains[best], max([g for k, (g, _) in enumerate(gains) if k != best], default=0.0)
    if count == 0 or residuals.deviations(gain, count) < certainty() or gain < max(SHARE * total, TWICE * others):
        return
    yield Finding(
        "one bad joint",
        f"{case.robot.joints[best].name} turns unevenly: that alone explains {100 * gain / total:.0f} % of the "
        f"residuals' squares, any other joint at most {100 * others / total:.0f} %; look at its gear and encoder, or "
        "identify with --errors auto",
    )


def _outliers(case: Case) -> Iterator[Finding]:
    """Touches that were left out."""
    out = np.unique(case.rows.owner[~case.estimate.used & case.rows.counted])
    if not len(out):
        return
    r = case.problem.residual(case.estimate.x)
    worst = int(np.argmax(np.where(~case.estimate.used & case.rows.counted, np.abs(r), 0.0)))
    names = tuple(case.rows.ids[i] for i in out)
    yield Finding(
        "outliers",
        f"{len(names)} of {len(case.rows.ids)} measurements disagree with all others and were left out, the worst, "
        f"{case.rows.ids[case.rows.owner[worst]]}, by {r[worst]:+.2f} mm",
        names,
    )
