"""Where a base and a tool that nobody measured stand: a closed-form start from what was measured."""

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.frames import nearest_rotation, pose
from identify.model.measurement import Rows


def starting_point(cell: Cell, rows: Rows) -> Float[np.ndarray, " parameters"]:
    """Nominal parameters, with the base and the tool fitted where the cell says `fit`; raises InputError.

    The tip in the jig frame is R (F t + o) + p for the base rotation R and position p, the tool point t, and the flange
    rotation F and position o by the nominal robot.
    """
    if cell.base is not None and cell.tool is not None:
        return cell.theta
    offset, points = rows.offset, _points(rows)
    if points is not None and cell.base is None and cell.tool is None:
        first, point = points
        o, F = cell.kinematics.flange(rows.q[first], cell.theta)
        base, tool = _from_points(point, F, o)
        return cell.robot.theta(base, np.concatenate([tool, np.zeros(3)]))
    o, F = cell.kinematics.flange(rows.q, cell.theta)
    if cell.base is not None:
        tool = _tool_point(cell.base, rows, F, o)
        return cell.robot.theta(cell.base, np.concatenate([tool, np.zeros(3)]))
    if cell.tool is not None:
        tip = (F @ cell.tool[:3, None])[..., 0] + o
        base = _base(rows.normal, offset, tip)
        return cell.robot.theta(base, cell.tool)
    base, tool = _from_planes(rows.normal, offset, F, o)
    return cell.robot.theta(base, np.concatenate([tool, np.zeros(3)]))


def _tool_point(base: np.ndarray, rows: Rows, F: np.ndarray, o: np.ndarray) -> Float[np.ndarray, " 3"]:
    """The tool point, linear in n . (R (F t + o) + p) = c."""
    from identify.model.frames import transform

    jig_T_base = transform(base)
    n = rows.normal @ jig_T_base[:3, :3]
    c = rows.offset - rows.normal @ jig_T_base[:3, 3] - (n * o).sum(axis=1)
    return _solve(np.einsum("mi,mij->mj", n, F), c, "tool")


def _points(rows: Rows) -> tuple[np.ndarray, np.ndarray] | None:
    """First rows of the measured positions and the positions, where all rows come in threes along x, y, z."""
    m = len(rows) // 3
    whole = len(rows) == 3 * m and np.array_equal(rows.normal, np.tile(np.eye(3), (m, 1)))
    whole = whole and np.array_equal(rows.owner[::3], rows.owner[2::3])
    return (np.arange(0, len(rows), 3), rows.offset.reshape(m, 3)) if whole else None


def _from_points(point: np.ndarray, F: np.ndarray, o: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Base pose and tool point from positions: R'y - R'p - F t = o is linear in R', R'p and t; R' is then projected."""
    m = len(point)
    A = np.zeros((m, 3, 15))
    for k in range(3):
        A[:, k, 3 * k : 3 * k + 3] = point - point.mean(axis=0)
    A[:, :, 9:12], A[:, :, 12:] = -np.eye(3), -F
    x = _solve(A.reshape(3 * m, 15), o.ravel(), "base and tool")
    R = nearest_rotation(x[:9].reshape(3, 3).T)
    # again with the rotation held, so that its projection does not leave the others behind
    B = np.concatenate([np.tile(R.T, (m, 1, 1)), F], axis=2).reshape(3 * m, 6)
    y = _solve(B, (point @ R - o).ravel(), "base and tool")
    return pose(_matrix(R, y[:3])), y[3:]


def _base(n: np.ndarray, c: np.ndarray, tip: np.ndarray) -> Float[np.ndarray, " 6"]:
    """The base pose from planes, the tool being known: n'R x + n'p = c is linear in R and p; R is then projected."""
    A = np.concatenate([np.einsum("mi,mj->mij", n, tip).reshape(len(n), 9), n], axis=1)
    R = nearest_rotation(_solve(A, c, "base")[:9].reshape(3, 3))
    return pose(_matrix(R, _solve(n, c - np.einsum("mi,ij,mj->m", n, R, tip), "base")))


def _from_planes(n: np.ndarray, c: np.ndarray, F: np.ndarray, o: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Base pose and tool point from planes: linear in R, p and the 27 products of R and t; R is then projected."""
    m = len(n)
    products = np.einsum("mi,mjk->mijk", n, F)  # n_i R_ij F_jk t_k: coefficients of the products R_ij t_k
    A = np.concatenate([np.einsum("mi,mj->mij", n, o).reshape(m, 9), n, products.reshape(m, 27)], axis=1)
    x = _solve(A, c, "base and tool")
    R = nearest_rotation(x[:9].reshape(3, 3))
    B = np.concatenate([n, np.einsum("mi,ij,mjk->mk", n, R, F)], axis=1)
    y = _solve(B, c - np.einsum("mi,ij,mj->m", n, R, o), "base and tool")
    return pose(_matrix(R, y[:3])), y[3:]


def _matrix(R: np.ndarray, p: np.ndarray) -> Float[np.ndarray, "4 4"]:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def _solve(A: np.ndarray, b: np.ndarray, what: str) -> np.ndarray:
    """Least squares with columns of one size; raises InputError where the rows cannot tell the unknowns apart."""
    unit = np.linalg.norm(A, axis=0)
    if len(A) < A.shape[1] or (unit == 0).any():
        raise InputError(
            f"{what}: fit needs at least {A.shape[1]} independent measurements, there are {len(A)}; "
            "measure more, or write the nominal frames in cell.yaml"
        )
    triangle = np.asarray(np.linalg.qr(np.column_stack([A / unit, b]), mode="r"))  # the same least squares in few rows
    return np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=1e-10)[0] / unit
