"""Plans for the virtual cell, made without the planner: random points of faces, reached by a Newton iteration."""

from dataclasses import replace
from itertools import islice

import numpy as np

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.virtual.collision import Surroundings
from probe.virtual.truth import Truth

FACES = ("top-low", "top-high", "front-low", "front-high", "right-low", "right-high", "left-low", "back-high")
STARTS = 6


def make_plan(cell: Cell, count: int, seed: int = 1, inset: float = 30.0, max_tilt: float = 40.0) -> Plan:
    """Touches at random points of faces, by the nominal model; the same for the same seed."""
    rng, targets = np.random.default_rng(seed), 6 * count
    point, normal, face, axis = _targets(cell, targets, rng, inset, max_tilt)
    tip = point + normal * cell.wire.radius * np.sqrt(1 - np.einsum("ij,ij->i", axis, normal)[:, None] ** 2)
    robot = cell.robot
    q = 0.6 * rng.uniform(robot.lower, robot.upper, (STARTS * len(tip), len(robot.joints)))
    q = solve(cell, q, np.repeat(tip, STARTS, axis=0), np.repeat(axis, STARTS, axis=0), 30)
    good = reached(cell, q, np.repeat(tip, STARTS, axis=0), np.repeat(axis, STARTS, axis=0), margin=0.2)
    chosen, first = np.unique(np.flatnonzero(good) // STARTS, return_index=True)
    q = q[np.flatnonzero(good)[first]]
    away = tip[chosen] + cell.touch.approach * normal[chosen]
    approach = solve(cell, q, away, axis[chosen], 15)
    near = reached(cell, approach, away, axis[chosen], margin=0.0) & (np.abs(approach - q).max(axis=1) < 0.5)
    clear = (i for i in np.flatnonzero(near) if untouched(cell, approach[i], q[i]))
    keep = np.fromiter(islice(clear, count), int)
    at = chosen[keep]
    assert len(keep) == count, f"{len(keep)} of {count} touches found"
    ids = tuple(f"t{i + 1:03d}" for i in range(count))
    return Plan(ids, tuple(face[i] for i in at), point[at], normal[at], q[keep], approach[keep])


def untouched(cell: Cell, start: np.ndarray, end: np.ndarray) -> bool:
    """Whether arm and torch of the nominal robot hit nothing on the straight way, nor half a degree beside it."""
    shift = np.radians(0.5) * np.concatenate([0 * end[None], np.eye(len(end)), -np.eye(len(end))])
    q = start + np.linspace(0, 1, 6)[:, None] * (end - start)
    looks = (q[None] + shift[:, None]).reshape(-1, len(end))
    return Surroundings(cell, cell.robot).first(looks, cell.theta) is None


def _targets(
    cell: Cell, count: int, rng: np.random.Generator, inset: float, max_tilt: float
) -> tuple[np.ndarray, np.ndarray, list[str], np.ndarray]:
    """Contact points, normals and faces, and wires that point at them from above, tilted from the normal."""
    assert cell.jig is not None
    faces = [cell.jig.by_name[FACES[i % len(FACES)]] for i in range(count)]
    margin = inset / np.array([f.size for f in faces])
    st = rng.uniform(margin, 1 - margin)
    point = np.array([f.point(np.array(s), np.array(t)) for f, (s, t) in zip(faces, st, strict=True)])
    normal, u = np.array([f.normal for f in faces]), np.array([f.u / f.size[0] for f in faces])
    tilt, turn = np.deg2rad(rng.uniform(10, max_tilt, (count, 1))), rng.uniform(0, 2 * np.pi, (count, 1))
    axis = -np.cos(tilt) * normal + np.sin(tilt) * (np.cos(turn) * u + np.sin(turn) * np.cross(normal, u))
    above = axis[:, 2] < -0.15
    kept = [f.name for f, ok in zip(faces, above, strict=True) if ok]
    return point[above], normal[above], kept, axis[above]


def solve(cell: Cell, q: np.ndarray, tip: np.ndarray, axis: np.ndarray, steps: int) -> np.ndarray:
    """Joints that bring the nominal tip to points with the wire along axes, by a damped Newton iteration."""
    for _ in range(steps):
        position, R, J = cell.kinematics.pose_jacobian(q, cell.theta)
        J = J * np.repeat([1.0, 300.0], 3)[:, None]  # a radian is worth a length, so that the damping is fair
        e = np.hstack([tip - position, 300 * np.cross(R[:, :, 2], axis)])
        normal = np.einsum("nki,nkj->nij", J, J) + 1e-3 * np.eye(J.shape[2])
        step = np.linalg.solve(normal, np.einsum("nki,nk->ni", J, e)[:, :, None])[:, :, 0]
        q = q + step * np.minimum(1, 0.4 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-9))
    return q


def reached(cell: Cell, q: np.ndarray, tip: np.ndarray, axis: np.ndarray, margin: float) -> np.ndarray:
    """Which joints are right, and within their limits by a margin [rad]."""
    position, R = cell.kinematics.tip(q, cell.theta)
    right = np.linalg.norm(position - tip, axis=1) < 1e-6
    right &= np.einsum("ni,ni->n", R[:, :, 2], axis) > 1 - 1e-9
    return right & ((q > cell.robot.lower + margin) & (q < cell.robot.upper - margin)).all(axis=1)


def with_effects(truth: Truth, **effects: object) -> Truth:
    """The same truth with some of its effects changed."""
    return replace(truth, effects=replace(truth.effects, **effects))
