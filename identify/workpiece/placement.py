"""Where a body with known planes stands, from points on them: every start at once, and what the touches do not see."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float

GRID = 1000  # rotations to start from, spread evenly
STARTS = 16  # of them that are followed
ITERATIONS = 40
LEAN = np.cos(np.radians(85))  # between wire and normal: touches come from outside
SMALL = 1e-10  # of the sum of squares, that ends the search
UNSEEN = 0.02  # a move of 1 mm (at the rim, for a rotation) that changes no touch by more is not seen


@dataclass(frozen=True, eq=False)
class Contacts:
    """Touches of a body: planes in its own frame, and where the tip was, and how it stood, in the frame of the base."""

    normal: Float[np.ndarray, "touches 3"]
    offset: Float[np.ndarray, " touches"]  # [mm]
    tip: Float[np.ndarray, "touches 3"]  # [mm]
    axis: Float[np.ndarray, "touches 3"]  # of the wire, away from the flange
    radius: Float[np.ndarray, " touches"]  # [mm], of a flat wire end

    def __len__(self) -> int:
        return len(self.offset)


@dataclass(frozen=True, eq=False)
class Placement:
    """Poses of a body, many at once."""

    R: Float[np.ndarray, "*poses 3 3"]
    p: Float[np.ndarray, "*poses 3"]  # [mm]

    def moved(self, twist: Float[np.ndarray, "*poses 6"]) -> "Placement":
        """Moved by a way [mm] and a rotation vector [rad] in the body's own axes."""
        way = (self.R @ twist[..., :3, None])[..., 0]
        return Placement(self.R @ rotation_of(twist[..., 3:]), self.p + way)

    def residual(
        self, touched: Contacts
    ) -> tuple[Float[np.ndarray, "*poses touches"], Float[np.ndarray, "*poses touches 6"]]:
        """Distances of the tips from the planes [mm], and their Jacobian by a move of the body in its own axes."""
        y = (touched.tip - self.p[..., None, :]) @ self.R  # the tips in the frame of the body
        a = touched.axis @ self.R
        lean = (a * touched.normal).sum(axis=-1)
        sine = np.sqrt(np.maximum(1 - lean**2, 1e-12))
        r = (y * touched.normal).sum(axis=-1) - touched.offset - touched.radius * sine
        turn = _cross(y, touched.normal) + (touched.radius * lean / sine)[..., None] * _cross(a, touched.normal)
        n = np.broadcast_to(touched.normal, turn.shape)
        return r, -np.concatenate([n, turn], axis=-1)


def _cross(a: Float[np.ndarray, "*poses touches 3"], n: Float[np.ndarray, "touches 3"]) -> np.ndarray:
    """A x n; several times faster than NumPy's for few rows."""
    (x, y, z), (u, v, w) = np.moveaxis(a, -1, 0), n.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def rotation_of(v: Float[np.ndarray, "*many 3"]) -> Float[np.ndarray, "*many 3 3"]:
    """Rotation matrices of rotation vectors [rad] (Rodrigues)."""
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    zero = np.zeros(v.shape[:-1])
    rows = [[zero, -v[..., 2], v[..., 1]], [v[..., 2], zero, -v[..., 0]], [-v[..., 1], v[..., 0], zero]]
    K = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (K @ K))


@lru_cache(maxsize=1)
def grid() -> Float[np.ndarray, "rotations 3 3"]:
    """Rotations spread evenly over all that there are (Shoemake 1992, on a Roberts sequence)."""
    g = 1.2207440846057596  # root of x^4 = x + 1
    u = (0.5 + np.arange(GRID)[:, None] * g ** -np.arange(1.0, 4.0)) % 1
    a, b = np.sqrt(1 - u[:, 0]), np.sqrt(u[:, 0])
    s, t = 2 * np.pi * u[:, 1], 2 * np.pi * u[:, 2]
    x, y, z, w = a * np.sin(s), a * np.cos(s), b * np.sin(t), b * np.cos(t)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def starts(touched: Contacts, weight: Float[np.ndarray, " touches"]) -> Placement:
    """Rotations of the grid that fit best, each with the position that suits it, touched from outside if possible."""
    R = grid()
    n = touched.normal @ R.transpose(0, 2, 1)  # in the frame of the base
    fair = -(n * touched.axis).sum(axis=-1).max(axis=1) > LEAN
    A = n * weight[:, None]
    b = ((n * touched.tip).sum(axis=-1) - touched.offset) * weight
    H, g = A.transpose(0, 2, 1) @ A, (A.transpose(0, 2, 1) @ b[..., None])
    p = np.linalg.solve(H + 1e-9 * np.trace(H, axis1=1, axis2=2)[:, None, None] * np.eye(3), g)[..., 0]
    cost = (((A @ p[..., None])[..., 0] - b) ** 2).sum(axis=1)
    some = np.lexsort((cost, ~fair))[:STARTS]
    return Placement(R[some], p[some])


def settle(touched: Contacts, weight: Float[np.ndarray, "touches touches"], start: Placement) -> Placement:
    """Poses moved downhill until the weighted residuals are least (Levenberg and Marquardt), each from its start.

    `weight` whitens the residuals: the inverse of a root of their covariance.
    """

    def whitened(at: Placement) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        r, J = at.residual(touched)
        r = r @ weight.T
        return r, weight @ J, (r * r).sum(axis=1)

    at, damping = start, np.full(len(start.p), 1e-3)
    r, J, cost = whitened(at)
    for _ in range(ITERATIONS):
        H, g = J.transpose(0, 2, 1) @ J, (J.transpose(0, 2, 1) @ r[..., None])[..., 0]
        size = np.einsum("sii->si", H)
        D = (damping[:, None] * size + 1e-12 * size.max(axis=1, keepdims=True))[..., None] * np.eye(6)
        step = -np.linalg.solve(H + D, g[..., None])[..., 0]
        turn = np.linalg.norm(step[:, 3:], axis=1)
        step *= np.minimum(1.0, 0.7 / np.maximum(turn, 1e-12))[:, None]
        trial = at.moved(step)
        r_, J_, cost_ = whitened(trial)
        better = cost_ < cost
        over = np.abs(cost - cost_) <= SMALL * (1 + cost)
        pick = better[:, None]
        at = Placement(np.where(pick[..., None], trial.R, at.R), np.where(pick, trial.p, at.p))
        r, J, cost = np.where(pick, r_, r), np.where(pick[..., None], J_, J), np.where(better, cost_, cost)
        damping = np.where(better, damping / 10, np.minimum(damping * 10, 1e6))
        if over.all():
            break
    return at


def outside(touched: Contacts, at: Placement) -> Float[np.ndarray, " poses"]:
    """How far the most doubtful touch of each pose comes from outside: cosine of wire and inward normal."""
    return np.asarray((-(touched.axis @ at.R) * touched.normal).sum(axis=-1).min(axis=-1))


def sight(
    touched: Contacts, at: Placement, centre: Float[np.ndarray, " 3"], size: float
) -> tuple[Float[np.ndarray, " freedoms"], Float[np.ndarray, "freedoms 6"]]:
    """How much the touches change by moves of one millimetre, and the moves: ways, and rotations at the rim.

    The rotations are about the centre of the body; `size` [mm] is the distance of its rim.
    """
    around = replace(touched, offset=touched.offset - touched.normal @ centre)
    J = Placement(at.R, at.p + at.R @ centre).residual(around)[1] / np.array([1, 1, 1, size, size, size])
    _, s, Vt = np.linalg.svd(J, full_matrices=True)
    return np.concatenate([s, np.zeros(6 - len(s))]), Vt


def unseen(touched: Contacts, at: Placement, centre: Float[np.ndarray, " 3"], size: float) -> tuple[str, ...]:
    """A sentence for every freedom of the body that the touches do not see."""
    s, Vt = sight(touched, at, centre, size)
    dark = Vt[s < UNSEEN]
    if not len(dark):
        return ()
    # ways that are dark without any rotation come first; what is left of the dark needs rotations
    _, along, normals = np.linalg.svd(touched.normal)
    flat = normals[np.concatenate([along, np.zeros(3 - len(along))]) < UNSEEN]
    ways = _axes(flat, len(flat))
    turns = _axes(dark[:, 3:], len(dark) - len(flat))
    return (*(_way(k) for k in ways), *(_turn(k) for k in turns))


def _axes(directions: Float[np.ndarray, "directions 3"], count: int) -> list[int]:
    """So many of the axes x, y and z as the directions span, those first that they lie along."""
    rest, chosen_rows = directions.copy(), list[int]()
    for _ in range(count):
        k = int(np.argmax((rest**2).sum(axis=0)))
        chosen_rows.append(k)
        column = rest[:, k] / max(np.linalg.norm(rest[:, k]), 1e-300)
        rest = rest - np.outer(column, column @ rest)
    return sorted(chosen_rows)


def _way(k: int) -> str:
    return f"translation along {'xyz'[k]}: no touch is on a face that looks along {'xyz'[k]}"


def _turn(k: int) -> str:
    a, b = "xyz"[(k + 1) % 3], "xyz"[(k + 2) % 3]
    return (
        f"rotation about {'xyz'[k]}: no touches are spread along {b} on faces that look along {a}, nor along {a} on "
        f"faces that look along {b}"
    )
