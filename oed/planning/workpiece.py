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
from identify.uncertainty.knowledge import tip_errors, touch_sigma
from identify.uncertainty.promise import Promise, promise
from oed.candidates.candidates import Candidates
from oed.planning.candidate_set import Offer, offer, plan_of
from oed.planning.visitable import Best, visited
from probe.motion.roadmap import with_via
from probe.motion.tour import Order

FEWEST = 6  # freedoms of a rigid body
USUAL = 12
COUNT = 6000  # touches on offer
CURVE = (6, 8, 10, 12, 16, 24)
STEP = 1e-6  # for differences


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
    placed = standing(cell, workpiece, at, after)
    offered = offer(placed, rng, after=None if after is None else _open(placed, after), count=count)
    if n > len(offered.found):
        raise InputError(f"{n} touches are asked for, and only {len(offered.found)} were found that can be made")
    G = _motions(offered)
    touches, order = chosen(offered, n, "V", rng, G)
    return WorkpiecePlan(
        plan=with_via(plan_of(touches), order.via), cell=placed, faces=_faces(touches),
        promise=_promise(offered, G, touches), curve=_curve(offered, G), minutes=order.minutes,
        notes=(*offered.found.notes, *(f"the way after touch {i + 1} is not clear" for i in order.blocked)),
    )  # fmt: skip


def standing(
    cell: Cell, workpiece: Jig, at: Float[np.ndarray, " 6"] | None = None, after: Calibration | None = None
) -> Cell:
    """The cell with a workpiece in the place of the jig; there is no weld zone in its frame."""
    base = cell.base if after is None else after.theta[:6]
    base = base if at is None else pose(inverse(transform(at)))
    return replace(cell, jig=workpiece, base=base, zone=None)


def chosen(
    offered: Offer,
    n: int,
    criterion: str,
    rng: np.random.Generator,
    tip: Float[np.ndarray, "poses 3 kept"] | None = None,
) -> tuple[Candidates, Order]:
    """The best touches on offer by a criterion, for what moves as `tip` does, in an order in which they can be made."""
    order = visited(offered, Best(offered, n, criterion, tip), rng).order
    return offered.found.take(order.index), order


def _open(cell: Cell, after: Calibration) -> Calibration:
    """What a calibration tells of links and tool; where the workpiece stands is open within the base's tolerance."""
    assert cell.base is not None
    names = [name for name in cell.robot.parameters if name.startswith("base.")]
    links = [k for k, name in enumerate(after.estimated) if not name.startswith("base.")]
    size = len(names) + len(links)
    covariance = np.zeros((size, size))
    covariance[: len(names), : len(names)] = _tolerance(cell, cell.base)
    covariance[len(names) :, len(names) :] = after.covariance[np.ix_(links, links)]
    theta = np.concatenate([cell.base, after.theta[6:]])
    return replace(
        after, cell=cell, theta=theta, estimated=(*names, *(after.estimated[k] for k in links)), covariance=covariance
    )


def _tolerance(cell: Cell, base: Float[np.ndarray, " 6"]) -> Float[np.ndarray, "6 6"]:
    """Covariance of the base's pose as the workpiece sees it: the workpiece may stand off and turned about itself."""
    point = cell.the_jig.corners
    middle = (point.min(axis=0) + point.max(axis=0)) / 2
    to_middle = transform(np.concatenate([middle, np.zeros(3)]))
    seen = inverse(to_middle) @ transform(base)
    steps = STEP * np.concatenate([np.eye(6), -np.eye(6)])
    moved = pose(to_middle @ transform(steps) @ seen)
    A = (moved[:6] - moved[6:]).T / (2 * STEP)
    return A * np.repeat(cell.priors.base, 3) ** 2 @ A.T


def _motions(offered: Offer) -> Float[np.ndarray, "corners 3 kept"]:
    """How the corners of the faces move with the parameters that say where the base stands, whitened [mm]."""
    known, base = offered.known, offered.known.theta[:6]
    corner = known.cell.the_jig.corners
    fixed = inverse(transform(base)) @ np.column_stack([corner, np.ones(len(corner))])[..., None]  # in the base's frame
    G = np.zeros((len(corner), 3, len(known.names)))
    for k, (name, i) in enumerate(zip(known.names, known.kept, strict=True)):
        if name.startswith("base."):
            step = STEP * np.eye(6)[i]
            G[:, :, k] = ((transform(base + step) - transform(base - step)) @ fixed)[:, :3, 0] / (2 * STEP)
    return G * known.scale


def _promise(offered: Offer, G: Float[np.ndarray, "corners 3 kept"], touches: Candidates) -> Promise:
    names = touches.names()
    rows = offered.known.rows(
        touches.q, touches.normal, touch_sigma(offered.known.cell, names), approach=touches.approach
    )
    return promise(tip_errors(G, offered.known.error(rows, names)))


def _curve(offered: Offer, G: Float[np.ndarray, "corners 3 kept"]) -> tuple[tuple[int, dict[str, int], float], ...]:
    """What other numbers of touches would give, whether or not they can be visited one after the other."""
    out, everything = [], np.ones(len(offered.found), dtype=bool)
    for n in CURVE:
        if n <= len(offered.found):
            touches = offered.found.take(Best(offered, n, "V", G)(everything, None))
            out.append((n, _faces(touches), _promise(offered, G, touches).p95_mm))
    return tuple(out)


def _faces(touches: Candidates) -> dict[str, int]:
    return dict(Counter(touches.names()).most_common())
