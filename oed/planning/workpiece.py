"""Touches that locate a workpiece: the fewest that do, and the best of any number."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.frames import inverse, pose, transform
from identify.model.io.calibration_file import Calibration
from identify.model.jig import Jig
from identify.model.touch import Plan
from identify.uncertainty.information import Information, prior_information
from identify.uncertainty.posterior import posterior
from identify.uncertainty.promise import Promise
from identify.uncertainty.unknowns import Shared, Unknowns
from oed.candidates.candidates import Candidates
from oed.planning.candidate_set import CandidateSet, around, plan_of
from oed.planning.visitable import Best, visited
from probe.motion.roadmap import with_via
from probe.motion.tour import Order

FEWEST = 6  # freedoms of a rigid body
USUAL = 12
COUNT = 6000  # candidates
CURVE = (6, 8, 10, 12, 16, 24)
STEP = 1e-6  # for differences
CALIBRATED = "calibrated."  # before the name of a parameter of the base as it was calibrated


@dataclass(frozen=True, eq=False)
class WorkpiecePlan:
    """Touches of a workpiece, and how well its corners will be known in the frame of the robot's base."""

    plan: Plan
    cell: Cell  # the workpiece in the place of the jig, where it is thought to stand
    faces: dict[str, int]  # how many touches on each
    promise: Promise
    curve: tuple[tuple[int, dict[str, int], float], ...]  # numbers of touches, on which faces, and the 95 % error [mm]
    minutes: float
    notes: tuple[str, ...]


def plan_workpiece(
    cell: Cell,
    workpiece: Jig,
    n: int | None = None,
    rng: np.random.Generator | None = None,
    *,
    at: Float[np.ndarray, " 6"] | None = None,
    after: Calibration | None = None,
    count: int = COUNT,
) -> WorkpiecePlan:
    """Choose `n` touches of a workpiece (USUAL) that make its corners best known: the mean square error is least.

    `at` is about where it stands, a pose in the frame of the base [mm, rad]; the place of the jig if not given. The
    cell's tolerances of the base say how far off that may be. What a calibration (`after`) leaves open of the links
    adds to the error. Raises InputError where six freedoms cannot be seen.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    n = USUAL if n is None else n
    if n < FEWEST:
        raise InputError(f"{n} touches cannot locate a workpiece, which has 6 freedoms; plan at least {FEWEST}")
    placed = with_workpiece(cell, workpiece, at, after)
    candidate_set = around(workpiece_prior(placed, after), rng, count)
    if n > len(candidate_set.candidates):
        raise InputError(
            f"{n} touches are asked for, and only {len(candidate_set.candidates)} were found that can be made"
        )
    corners = corner_rows(candidate_set.prior, after)
    touches, order = best_in_order(candidate_set, n, "V", rng, corners)
    return WorkpiecePlan(
        plan=with_via(plan_of(touches), order.via),
        cell=replace(placed, robot=cell.robot),
        faces=_faces(touches),
        promise=candidate_set.promise_of(corners, touches),
        curve=_curve(candidate_set, corners),
        minutes=order.minutes,
        notes=(*candidate_set.candidates.notes, *(f"the way after touch {i + 1} is not clear" for i in order.blocked)),
    )


def with_workpiece(
    cell: Cell, workpiece: Jig, at: Float[np.ndarray, " 6"] | None = None, after: Calibration | None = None
) -> Cell:
    """The cell with a workpiece in the place of the jig; there is no weld zone in its frame."""
    base = cell.base if after is None else after.theta[:6]
    base = base if at is None else pose(inverse(transform(at)))
    robot = cell.robot if after is None else cell.robot.with_errors(after.cell.robot.errors)
    return replace(cell, robot=robot, jig=workpiece, base=base, zone=None)


def best_in_order(
    candidate_set: CandidateSet,
    n: int,
    criterion: str,
    rng: np.random.Generator,
    points: Float[np.ndarray, "points 3 unknowns"] | None = None,
) -> tuple[Candidates, Order]:
    """The best candidates by a criterion, for points that move by these rows, in an order in which they can be made."""
    order = visited(candidate_set, Best(candidate_set, n, criterion, points), rng).order
    return candidate_set.candidates.take(order.index), order


def workpiece_prior(placed: Cell, after: Calibration | None) -> Information:
    """What is known of the robot as the workpiece sees it: the base's pose there is off by the cell's tolerances.

    After a calibration, the base as it was calibrated is an unknown beside the base as the workpiece sees it: both
    share what the calibration leaves open of the base together with the links.
    """
    if after is None:
        return prior_information(placed)
    assert placed.base is not None
    estimate, count = posterior(after), len(after.estimated)
    C = estimate.covariance()[:count, :count]
    base = [k for k in range(count) if after.index[k] < 6]
    links = [k for k in range(count) if k not in base]
    A = _seen_from(placed, after)[:, [after.index[k] for k in base]]
    T = np.zeros((6 + len(links) + len(base), count))  # base as the workpiece sees it, links, base as calibrated
    T[:6, base] = A
    T[range(6, 6 + len(links)), links] = 1.0
    T[range(6 + len(links), len(T)), base] = 1.0
    covariance = T @ C @ T.T
    covariance[:6, :6] += np.diag(np.repeat(placed.priors.base, 3) ** 2)
    calibrated = [
        Shared(
            f"{CALIBRATED}{after.estimated[k]}",
            "deg" if after.cell.robot.angular[after.index[k]] else "mm",
            float(after.cell.scale[after.index[k]]),
            1.0,
            lambda at: np.zeros(len(at.rows)),
        )
        for k in base
    ]
    unknowns = Unknowns.of(replace(placed, fixed=frozenset()), further=calibrated)
    parameters = np.array([*range(6), *(after.index[k] for k in links)])
    names = [*placed.robot.parameters[:6], *(after.estimated[k] for k in links), *(c.name for c in calibrated)]
    theta = np.concatenate([placed.base, after.theta[6:]])
    return Information.of_covariance(replace(unknowns, parameters=parameters), theta, names, covariance)


def _seen_from(placed: Cell, after: Calibration) -> Float[np.ndarray, "6 6"]:
    """Derivative of the base's pose in the frame of the workpiece by its pose in the frame of the jig."""
    assert placed.base is not None
    workpiece_T_jig = transform(placed.base) @ inverse(transform(after.theta[:6]))
    steps = STEP * np.concatenate([np.eye(6), -np.eye(6)])
    placement = pose(workpiece_T_jig @ transform(after.theta[:6] + steps))
    return np.asarray((placement[:6] - placement[6:]).T / (2 * STEP))


def corner_rows(prior: Information, after: Calibration | None) -> Float[np.ndarray, "corners 3 unknowns"]:
    """How the corners of the faces move in the frame of the robot's base with the pose of the workpiece [mm].

    After a calibration only the workpiece moves, and not what the calibration leaves open of the base.
    """
    unknowns, base = prior.unknowns, prior.theta[:6]
    corner = unknowns.cell.the_jig.corners
    fixed = inverse(transform(base)) @ np.column_stack([corner, np.ones(len(corner))])[..., None]  # in the base's frame
    steps = STEP * np.eye(6)
    moves = [((transform(base + e) - transform(base - e)) @ fixed)[:, :3, 0] / (2 * STEP) for e in steps]
    G, rows = np.stack(moves, axis=2), np.zeros((len(corner), 3, len(unknowns)))
    rows[:, :, unknowns.index(unknowns.cell.robot.parameters[:6])] = G
    if after is not None:
        slopes = G @ _seen_from(unknowns.cell, after)
        for k, name in enumerate(unknowns.names):
            if name.startswith(CALIBRATED):
                rows[:, :, k] = -slopes[:, :, after.cell.robot.parameters.index(name.removeprefix(CALIBRATED))]
    return rows * unknowns.scale


def _curve(
    candidate_set: CandidateSet, corners: Float[np.ndarray, "corners 3 unknowns"]
) -> tuple[tuple[int, dict[str, int], float], ...]:
    """What other numbers of touches would give, whether or not they can be visited one after the other."""
    out, everything = [], np.ones(len(candidate_set.candidates), dtype=bool)
    for n in CURVE:
        if n <= len(candidate_set.candidates):
            touches = candidate_set.candidates.take(Best(candidate_set, n, "V", corners)(everything, None))
            out.append((n, _faces(touches), candidate_set.promise_of(corners, touches).p95_mm))
    return tuple(out)


def _faces(touches: Candidates) -> dict[str, int]:
    return dict(Counter(touches.names()).most_common())
