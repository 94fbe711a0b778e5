"""Touches of a jig at two places: what they promise, and what robots deliver that make them.

A jig that stands off its second place by D is touched as the jig at that place would be touched by a robot whose base
is D^-1 base. So every robot has a second base, and six more unknowns where the place is not known.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.frames import inverse, pose, rotation, transform
from identify.model.jig import Box, Face, Jig
from oed.design.exact import exact_design
from oed.design.relaxation import approximate_design
from oed.planning.candidate_set import CandidateSet, make_candidate_set, plan_of
from studies.common import arc_welder
from studies.jigs.jig_shown import TOUCHES
from studies.many import ManyTouches, Problem, draw_faces, draw_many, errors_in_zone, touch_every

SECOND = {  # shift [mm] and turn about the vertical [deg] of the jig
    "200 mm to the right": (200, 0, 0, 0),
    "200 mm to the left": (-200, 0, 0, 0),
    "150 mm nearer": (0, 150, 0, 0),
    "150 mm farther": (0, -150, 0, 0),
    "150 mm higher": (0, 0, 150, 0),
    "turned by 90°": (0, 0, 0, 90),
    "turned by 180°": (0, 0, 0, 180),
    "turned by 90°, 150 mm higher": (0, 0, 150, 90),
}
LOOSE = np.repeat([10.0, np.radians(2.0)], 3)  # [mm, rad] by which the second place is known
HIGH = 100.0  # [mm], what turns of the jig turn about, beside its place
SURE = 1e-6  # of that, where it is known
GAP = 1e-3
ITERATIONS = 8  # of Gauss-Newton
STEP = 1e-6  # [mm, rad], for differences of a base


@dataclass(frozen=True, eq=False)
class Case:
    """One way to use a jig."""

    name: str
    at: Float[np.ndarray, " 6"]  # [mm, rad], where the second place is
    promised: float  # [mm], RMS tip error that the best weights promise
    error: Float[np.ndarray, "robots poses"]  # [mm], of robots that made the best touches found


def second_places(
    name: str, count: int, robots: int, searches: int, zone: Float[np.ndarray, "poses joints"], rng: np.random.Generator
) -> Iterator[Case]:
    """The first place alone, and with the second called `name`, known exactly or not."""
    cell, at = arc_welder(), _place(name)
    here, there = (make_candidate_set(c, rng, count=count) for c in (cell, replace(cell, jig=put(cell.the_jig, at))))
    own, others = (one.rows_of(one.candidates) for one in (here, there))  # all of them meet: they are aimed
    tip, prior, pose_rows = here.prior.unknowns.tip_rows(zone), here.prior.R.T @ here.prior.R, _pose_rows(there, at)
    unknown = _joined(prior, np.eye(6))
    nothing, wider = np.zeros((len(own), 6)), np.pad(tip, ((0, 0), (0, 0), (0, 6)))
    both = np.vstack([own, others])
    free = np.block([[own, nothing], [others, pose_rows]])
    for what, loose, X, P, Z in (
        ("first place alone", SURE, own, prior, tip),
        (f"and {name}, place known", SURE, both, prior, tip),
        (f"and {name}, place unknown", 1.0, free, unknown, wider),
    ):
        weights = approximate_design(X, "V", GAP, touches=TOUCHES, prior=P, zone=Z)
        assert weights.gap <= GAP
        members = exact_design(
            X, TOUCHES, "V", prior=P, zone=Z, relaxation=weights, iterations=searches, rng=rng
        ).indices
        error = _delivered((here, there), members, at, loose * LOOSE, robots, zone, rng)
        yield Case(what, at, float(np.sqrt(weights.value)), error)


def _place(name: str) -> Float[np.ndarray, " 6"]:
    x, y, z, turn = SECOND[name]
    return np.array([x, y, z, np.radians(turn), 0.0, 0.0])


def _pose_rows(there: CandidateSet, at: Float[np.ndarray, " 6"]) -> Float[np.ndarray, "touches 6"]:
    """What touches tell of where the second place is, in units of LOOSE."""
    touches = there.candidates
    lever = np.cross(touches.point - (at[:3] + HIGH), touches.normal)
    return np.hstack([touches.normal, lever]) * LOOSE / there.cell.touch.sigma


def _joined(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """A matrix with two blocks."""
    return np.block([[A, np.zeros((len(A), len(B)))], [np.zeros((len(B), len(A))), B]])


def _delivered(
    offers: tuple[CandidateSet, CandidateSet],
    members: np.ndarray,
    at: np.ndarray,
    loose: np.ndarray,
    robots: int,
    zone: np.ndarray,
    rng: np.random.Generator,
) -> Float[np.ndarray, "robots poses"]:
    """Errors in the zone of robots drawn from the priors that made the chosen touches at both places."""
    first = offers[0].cell
    theta, off = draw_many(first, robots, rng), loose * rng.standard_normal((robots, 6))
    faces = int(rng.integers(2**32))  # the jig is the same at both places
    parts = []
    for k, (one, mine) in enumerate(zip(offers, _split(members, len(offers[0].rows)), strict=True)):
        if not len(mine):
            continue
        true = theta if k == 0 else with_second_base(theta, off, at)
        plan, cell = plan_of(one.candidates.take(mine)), one.cell
        proud = draw_faces(cell, plan, robots, np.random.default_rng(faces))
        touched = touch_every(cell, true, plan, rng, proud=proud)
        parts.append((k == 1, Problem(cell, touched, True, False), touched))
    fits = identified(first, parts, at, loose, robots)
    return errors_in_zone(first, theta, fits, zone)


def _split(members: np.ndarray, first: int) -> tuple[np.ndarray, np.ndarray]:
    return members[members < first], members[members >= first] - first


def with_second_base(
    theta: Float[np.ndarray, "robots parameters"], off: Float[np.ndarray, "robots 6"], at: Float[np.ndarray, " 6"]
) -> Float[np.ndarray, "robots parameters"]:
    """The robots whose base stands to the jig at its second place as theirs does to the jig that is `off` that place.

    The jig is shifted and turned about its middle.
    """
    middle = np.eye(4)
    middle[:3, 3] = at[:3] + HIGH
    shift = middle @ transform(off) @ inverse(middle)
    return np.hstack([pose(inverse(shift) @ transform(theta[:, :6])), theta[:, 6:]])


def identified(
    cell: Cell, parts: list[tuple[bool, Problem, ManyTouches]], at: np.ndarray, loose: np.ndarray, robots: int
) -> Float[np.ndarray, "robots parameters"]:
    """Least squares with priors, all parameters and where the second place is, by Gauss-Newton, all robots in step."""
    start, size = cell.theta, len(cell.theta)
    theta, off = np.tile(start, (robots, 1)), np.zeros((robots, 6))
    precision = np.append(cell.prior, loose) ** -2.0
    for _ in range(ITERATIONS):
        H = np.broadcast_to(np.diag(precision), (robots, size + 6, size + 6)).copy()
        gradient = np.hstack([theta - start, off]) * precision
        for second, problem, touched in parts:
            r, J = problem.linearize(with_second_base(theta, off, at) if second else theta)
            J = np.pad(J / problem.scale, ((0, 0), (0, 0), (0, 6)))
            J = _by_both(J, theta, off, at) if second else J
            J, r = J * touched.hit[:, :, None], r * touched.hit
            H += J.transpose(0, 2, 1) @ J
            gradient += np.einsum("rmk,rm->rk", J, r)
        scale = 1 / np.sqrt(np.diagonal(H, axis1=1, axis2=2))
        H *= scale[:, :, None] * scale[:, None, :]
        step = -scale * np.linalg.solve(H, (scale * gradient)[:, :, None])[:, :, 0]
        theta, off = theta + step[:, :size], off + step[:, size:]
    return theta


def _by_both(J: np.ndarray, theta: np.ndarray, off: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Jacobian by the second base turned into that by the first one and by where the second place is."""
    by_second, out = J[:, :, :6], J.copy()
    for k in range(6):
        step, turn = STEP * np.eye(theta.shape[1])[k], STEP * np.eye(6)[k]
        base = with_second_base(theta + step, off, at) - with_second_base(theta - step, off, at)
        place = with_second_base(theta, off + turn, at) - with_second_base(theta, off - turn, at)
        for column, change in ((k, base), (k - 6, place)):
            out[:, :, column] = np.einsum("rmk,rk->rm", by_second, change[:, :6]) / (2 * STEP)
    return out


def put(jig: Jig, at: Float[np.ndarray, " 6"]) -> Jig:
    """The jig shifted, and turned about the vertical through its middle by right angles; what it stands on stays."""
    R = np.round(rotation(at[3], 0.0, 0.0))
    middle = np.array([200.0, 150.0, 0.0])

    def there(point: np.ndarray) -> np.ndarray:
        return np.asarray(R @ (point - middle) + middle + at[:3])

    faces = tuple(Face(f.name, there(f.origin), R @ f.u, R @ f.v, f.tolerance) for f in jig.faces)
    boxes = []
    for box in jig.boxes:
        corners = np.stack([there(np.array(box.lower)), there(np.array(box.upper))])
        lower, upper = corners.min(axis=0), corners.max(axis=0)
        below = box.upper[2] <= 0
        boxes.append(box if below else Box(tuple(lower.tolist()), tuple(upper.tolist())))
    return Jig(jig.name, faces, tuple(boxes))
