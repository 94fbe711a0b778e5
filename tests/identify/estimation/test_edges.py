"""Touches beside an edge: by kinematics inverted at the hidden robot, and by fits from which each touch is left out."""

from dataclasses import replace

import numpy as np
import pytest
from measured import touches_at

from identify.estimation.calibrate import calibrate
from identify.estimation.edges import BESIDE, RARE, doubts
from identify.estimation.problem import Problem
from identify.estimation.robust import Estimate, estimate
from identify.model.ik import reach
from identify.model.measurement import equations

DOWN = np.diag([1.0, -1.0, -1.0])
MARGIN = 25.0  # [mm] of good touches to the edges
COUNT = 40


@pytest.fixture(scope="module")
def truth(arc_welder):
    return arc_welder.theta + 0.1 * arc_welder.spread * np.random.default_rng(3).standard_normal(len(arc_welder.theta))


@pytest.fixture(scope="module")
def touches(arc_welder, truth):
    """Touches of faces away from their edges, and a last one: on top-high 0.3 mm from left-high, recorded there."""
    cell, rng = arc_welder, np.random.default_rng(8)
    faces = [cell.jig.faces[k] for k in rng.integers(len(cell.jig.faces), size=3 * COUNT)]
    at = np.array([face.point(*(rng.uniform(MARGIN, face.size - MARGIN) / face.size)) for face in faces])
    left, top = cell.jig.by_name["left-high"], cell.jig.by_name["top-high"]
    edge = top.origin + 0.5 * (top.u + top.v)
    edge = edge - (left.normal @ edge - left.offset + 0.3) * left.normal
    tilt = [np.linalg.norm(np.cross(face.normal, DOWN[:, 2])) for face in faces]
    at += [cell.wire.radius * lean * face.normal for lean, face in zip(tilt, faces, strict=True)]
    start = rng.uniform(cell.robot.lower, cell.robot.upper, (len(at) + 1, 6)) / 2
    turned = np.tile(DOWN, (len(at) + 1, 1, 1))
    found = reach(cell.kinematics, truth, np.vstack([at, edge]), turned, start, free_roll=True)
    good = [*np.flatnonzero(found.reached()[:-1])[: COUNT - 1], len(at)]
    assert len(good) == COUNT
    assert found.reached()[-1]
    faces = [[*faces, left][i] for i in good]
    blank = touches_at(cell, truth, found.q[good], rng)
    normal, offset = np.stack([f.normal for f in faces]), np.array([f.offset for f in faces])
    return replace(blank, face=tuple(f.name for f in faces), normal=normal, offset=offset)


def test_a_touch_that_met_the_next_face_is_not_used_and_the_others_are(arc_welder, touches):
    noisy = replace(touches, offset=touches.offset + 0.05 * np.random.default_rng(1).standard_normal(COUNT))

    found = calibrate(arc_welder, noisy, folds=0, errors="cell")

    doubtful = {name for finding in found.findings if finding.kind == "edge" for name in finding.ids}
    out = doubtful | set(found.outliers) | {n for f in found.findings if f.kind == "wrong face" for n in f.ids}
    assert touches.ids[-1] in out
    assert len(out) <= 2


def test_the_odds_of_a_face_are_those_of_a_fit_without_the_touch(arc_welder, touches):
    cell = arc_welder
    problem = Problem.pose(cell, equations(cell, [touches]), "linear", True, eliminate=False)
    weight = 1 / problem.rows.sigma
    x = problem.solve(estimate(problem).x, weight, "linear").x
    found = Estimate(x, np.ones(COUNT, dtype=bool), weight, 1.0, 0, 0.0)

    odds = doubts(problem, found, touches, problem.rows.sigma)

    i = COUNT - 1
    assert np.isfinite(odds[i])
    (_, r, J), *_ = problem.linearized(found.x)
    others = (np.arange(COUNT) != i)[:, None] * J / 0.05
    C = np.linalg.inv(others.T @ others + np.diag(1 / problem.prior**2))
    step = -C @ (others.T @ (r / 0.05) + found.x / problem.prior**2)

    def log_density(name):
        face = cell.jig.by_name[name]
        row = replace(problem.rows.take([i]), face=(name,), normal=face.normal[None], offset=np.array([face.offset]))
        away, slope = problem.unknowns.linearize(problem.unknown(found.x), row)
        a = (slope @ problem.basis)[0]
        variance = 0.05**2 + a @ C @ a
        return -0.5 * (away[0] + a @ step) ** 2 / variance - 0.5 * np.log(variance)

    tip = cell.kinematics.tip(touches.q[i:], problem.theta(found.x))[0][0]
    beside = [face for face in cell.jig.faces if face.name != "left-high" and abs(face.normal @ tip - face.offset) < 20]
    spans = {face.name: np.maximum(-face.fractions(tip), face.fractions(tip) - 1) * face.size for face in beside}
    others = max(log_density(name) for name, out in spans.items() if out.max() < BESIDE)
    assert odds[i] == pytest.approx(log_density("left-high") + RARE - others, rel=1e-3)
