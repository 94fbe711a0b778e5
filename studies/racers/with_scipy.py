"""SciPy's least_squares on the equations of a touch written in NumPy, one array operation for all touches."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy.optimize import least_squares

Problem = dict[str, np.ndarray]
Vector = list[np.ndarray]  # x, y, z of all poses


def tip(p: np.ndarray, q: np.ndarray, v: Vector, w: float) -> Vector:
    """A point (w = 1) or direction (w = 0) of the tool frame in the jig frame, x, y and z of every pose [mm]."""
    v = _pose(p[-6:], v, w)
    for i in reversed(range(q.shape[1])):
        theta, d, a, alpha, beta = p[6 + 5 * i : 11 + 5 * i]
        x, y, z = _rx(alpha, _ry(beta, v))
        v = _rz(theta + q[:, i], [x + a * w, y, z + d * w])
    return _pose(p[:6], v, w)


def _pose(pose: np.ndarray, v: Vector, w: float) -> Vector:
    turned = _rz(pose[3], _ry(pose[4], _rx(pose[5], v)))
    return [value + w * shift for value, shift in zip(turned, pose[:3], strict=True)]


def _rz(angle: np.ndarray, v: Vector) -> Vector:
    c, s = np.cos(angle), np.sin(angle)
    return [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]


def _ry(angle: np.ndarray, v: Vector) -> Vector:
    c, s = np.cos(angle), np.sin(angle)
    return [c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]]


def _rx(angle: np.ndarray, v: Vector) -> Vector:
    c, s = np.cos(angle), np.sin(angle)
    return [v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]]


ORIGIN: Vector = [np.zeros(1)] * 3
AXIS: Vector = [np.zeros(1), np.zeros(1), np.ones(1)]


def along(n: np.ndarray, v: Vector) -> np.ndarray:
    """The part of vectors along normals."""
    return np.asarray(n[0] * v[0] + n[1] * v[1] + n[2] * v[2])


def start(problem: Problem) -> np.ndarray:
    """Nominal parameters; base and tool where the problem says that they roughly are."""
    return np.concatenate([problem["base"], problem["dh"].ravel(), problem["tool"]])


def residual(problem: Problem) -> Callable[[np.ndarray], np.ndarray]:
    """What is to be small: touches or positions in units of sigma, then parameters in units of their tolerances."""
    q, sigma, begin = problem["q"], problem["sigma"], start(problem)
    proper = np.isfinite(problem["prior"])
    if "normal" in problem:
        n, c, radius = problem["normal"].T, problem["offset"], problem["radius"]

        def misfit(p: np.ndarray) -> np.ndarray:
            extent = radius * np.sqrt(np.maximum(1 - along(n, tip(p, q, AXIS, 0.0)) ** 2, 1e-12))
            return np.asarray((along(n, tip(p, q, ORIGIN, 1.0)) - c - extent) / sigma)
    else:
        point = problem["point"].T

        def misfit(p: np.ndarray) -> np.ndarray:
            return np.concatenate([(a - b) / sigma for a, b in zip(tip(p, q, ORIGIN, 1.0), point, strict=True)])

    return lambda p: np.concatenate([misfit(p), ((p - begin) / problem["prior"])[proper]])


def identify(method: Literal["trf", "lm"]) -> Callable[[Problem], Problem]:
    """Least squares with finite differences, parameters scaled by their tolerances."""

    def solve(problem: Problem) -> Problem:
        solution = least_squares(residual(problem), start(problem), method=method, x_scale=problem["scale"])
        return {"tip": np.transpose(tip(solution.x, problem["q_unseen"], ORIGIN, 1.0))}

    return solve


METHODS = {"SciPy trf": identify("trf"), "SciPy lm": identify("lm")}
