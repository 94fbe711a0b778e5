"""Why a face of the jig is not touched, in words."""

import numpy as np
from jaxtyping import Int

from identify.model.ik import reach
from oed.candidates.edge_margins import EDGE
from oed.candidates.feasibility import Judge, Verdict

STARTS = 60  # postures tried for a face that was never reached
FAILURES = {
    Verdict.TILT: "lean too far",
    Verdict.LIMITS: "lie beyond the joint limits",
    Verdict.EDGE: "touch too near to an edge",
    Verdict.JIG: "bring arm or torch too near to the jig or the table",
    Verdict.ARM: "bring arm and torch too near to each other",
    Verdict.APPROACH: "have no approach before them",
    Verdict.SEARCH: "leave no room within the joint limits to search beyond the contact",
    Verdict.PATH: "lead the tip off the face on the way",
    Verdict.WIRE: "bring the bare wire to something else first",
}


def reasons(judge: Judge, tally: Int[np.ndarray, "faces verdicts"]) -> tuple[str, ...]:
    """A sentence for every face on which no touch was found; `tally` counts the verdicts on postures that reach it."""
    empty = np.flatnonzero(tally[:, Verdict.FINE] == 0)
    leaning = tally[:, Verdict.TILT] == tally.sum(axis=1)  # or not reached at all
    return tuple(_unreached(judge, i) if leaning[i] else _refused(judge, i, tally[i]) for i in empty.tolist())


def _refused(judge: Judge, i: int, counts: Int[np.ndarray, " verdicts"]) -> str:
    """The face is reached, but no touch of it can be made."""
    assert judge.cell.jig is not None
    order = sorted(Verdict, key=lambda v: -counts[v])
    most = [v for v in order if counts[v] >= 0.01 * counts.sum()]
    shares = ", ".join(f"{counts[v] / counts.sum():.0%} {FAILURES[v]}" for v in most)
    face = judge.cell.jig.faces[i]
    narrow = f"; it is only {face.size.min():.0f} mm wide" if face.size.min() < 4 * EDGE else ""
    return f"face '{face.name}' cannot be touched: of {counts.sum()} postures that reach it, {shares}{narrow}."


def _unreached(judge: Judge, i: int) -> str:
    """No posture within the limits of joints and tilt brings the tip to the face: how far off it stays."""
    cell = judge.cell
    assert cell.jig is not None
    face, robot = cell.jig.faces[i], cell.robot
    s, t = (x.ravel() for x in np.meshgrid([0.1, 0.5, 0.9], [0.1, 0.5, 0.9]))
    point = np.repeat(face.point(s, t), STARTS, axis=0)
    start = np.random.default_rng(4).uniform(robot.lower, robot.upper, (len(point), len(robot.joints)))
    R = np.broadcast_to(np.eye(3), (len(point), 3, 3))
    found = reach(cell.kinematics, judge.theta, point, R, start, free_orientation=True, iterations=80)
    near = found.residual < 0.01
    if not near.any():
        return (
            f"face '{face.name}' is out of reach: the tip comes no nearer than {found.residual.min():.0f} mm; move the "
            "jig or the base, or check their poses in cell.yaml."
        )
    if not (near & found.within_limits).any():
        return f"face '{face.name}' is reached only beyond the joint limits of robot '{robot.name}'."
    _, R = cell.kinematics.tip(found.q[near & found.within_limits], judge.theta)
    tilt = np.degrees(np.arccos(np.clip(-R[:, :, 2] @ face.normal, -1, 1).max()))
    return (
        f"face '{face.name}' is reached only with the wire about {tilt:.0f} degrees off its normal, more than "
        f"max_tilt_deg: {np.degrees(cell.touch.max_tilt):.0f}; turn the jig or bend the torch."
    )
