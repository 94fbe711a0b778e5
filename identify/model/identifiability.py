"""Which parameters touches can tell apart: structural elimination, rank at given touches, weak directions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.measurement import Rows, measurement_model, tip_rows
from identify.model.robot import POSE_NAMES, Robot

POSES = 2  # generic poses a parameter, three rows each: far more than parameters
TOLERANCE = 1e-9  # of a column's part that no other column explains, relative to the column
UNSEEN = 1e-8  # singular values of columns of length one, below which touches do not see a direction
ORDER = ("theta", "alpha", "a", "d", "beta")


@dataclass(frozen=True)
class Identifiability:
    """The parameters that tip positions determine, and what carries the others."""

    names: tuple[str, ...]
    kept: tuple[int, ...]  # indices into `names`, in their order
    combinations: Mapping[str, Mapping[str, float]]  # eliminated name -> {kept name: coefficient}, [mm, rad]

    @property
    def rank(self) -> int:
        """The number of independent parameters."""
        return len(self.kept)


def preference(robot: Robot) -> Int[np.ndarray, " parameters"]:
    """Indices of parameters, those that stay first.

    The base and the tip come first: they are the set-up's own and the least known. Then joint offsets, twists and
    lengths, from the last joint to the first, so that of two parallel axes the outer d stays; beta, which only parallel
    axes need, then what is beyond geometry, so that nothing is called an error that geometry explains; the tool's
    orientation, which no tip position shows, comes last.
    """
    base, tip, orientation = (
        [f"{frame}.{axis}" for axis in axes]
        for frame, axes in (("base", POSE_NAMES), ("tool", POSE_NAMES[:3]), ("tool", POSE_NAMES[3:]))
    )
    links = [f"{joint.name}.{name}" for name in ORDER for joint in reversed(robot.joints)]
    beyond = [name for name, _, _ in robot.error_parameters]
    order = [*base, *tip, *links, *beyond, *orientation]
    return np.array([robot.parameters.index(name) for name in order])


def structure(
    cell: Cell,
    theta: Float[np.ndarray, " parameters"] | None = None,
    still: Mapping[int, float] | None = None,
    conditions: Float[np.ndarray, "rows conditions"] | None = None,
) -> Identifiability:
    """Eliminate the parameters whose tip-position columns vanish or depend on others for every configuration.

    `theta` is where the columns are taken, the nominal parameters if not given. Joints in `still` keep their value
    [rad] or [mm]; all others move between their limits. `made` are the conditions under which touches were made; if
    not given, every joint may come from both sides and the temperature changes. Columns are scaled by the cell's priors
    and taken in the order of `preference`; one that those before it explain is eliminated. The wire's end is left out:
    it shows the tool's tilt with a lever of its radius, half a millimetre, which is no ground to estimate it.
    """
    robot = cell.robot
    rng = np.random.default_rng(1)
    q = rng.uniform(robot.lower, robot.upper, (POSES * len(robot.parameters), len(robot.joints)))
    for joint, value in (still or {}).items():
        q[:, joint] = value
    poses = replace(tip_rows(q), conditions=np.repeat(_conditions(conditions, q.shape, rng), 3, axis=0))
    _, J = measurement_model(robot).linearize(cell.theta if theta is None else theta, poses)
    free = [i for i in preference(robot) if robot.parameters[i] not in cell.fixed]
    basic, combinations = independent(J * cell.scale, free)
    names = robot.parameters
    return Identifiability(
        names,
        tuple(sorted(basic)),
        {
            names[i]: {names[k]: _clean(c * cell.scale[k] / cell.scale[i]) for k, c in terms.items()}
            for i, terms in sorted(combinations.items())
        },
    )


def visible(
    cell: Cell,
    theta: Float[np.ndarray, " parameters"],
    some: Int[np.ndarray, " some"],
    still: Mapping[int, float] | None = None,
    conditions: Float[np.ndarray, "rows conditions"] | None = None,
    leaning: bool = False,
) -> Float[np.ndarray, "some directions"]:
    """An orthonormal basis of the directions of some parameters that measurements can show of robots near the drawing.

    Parameters are in units of their priors. The Jacobian is taken at generic poses, each of another robot drawn from
    the priors, because axes that are parallel on the drawing are not on a robot as built; `leaning` says that the wire
    has a flat end, which shows the tilt of the tool. What nothing shows keeps the most probable value of the prior.
    Columns without a prior have a basis of their own, and what they can make up for is not shown of the others.
    """
    robot, rng = cell.robot, np.random.default_rng(1)
    q = rng.uniform(robot.lower, robot.upper, (POSES * len(robot.parameters), len(robot.joints)))
    for joint, value in (still or {}).items():
        q[:, joint] = value
    poses = replace(tip_rows(q), conditions=np.repeat(_conditions(conditions, q.shape, rng), 3, axis=0))
    if leaning:
        normal = rng.standard_normal(poses.normal.shape)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        poses = replace(poses, normal=normal, radius=np.ones(len(normal)))
    robots = np.repeat(theta + cell.spread * rng.standard_normal((len(q), len(theta))), 3, axis=0)
    _, J = measurement_model(robot).linearize(robots, poses)
    loose = np.isinf(cell.prior[some])
    R = np.asarray(np.linalg.qr((J * cell.scale)[:, some], mode="r"))
    free, explained = _row_space(R[:, loose])
    determined, _ = _row_space(R[:, ~loose] - explained @ (explained.T @ R[:, ~loose]))
    basis = np.zeros((len(some), free.shape[1] + determined.shape[1]))
    basis[np.ix_(loose, np.arange(free.shape[1]))] = free
    basis[np.ix_(~loose, np.arange(free.shape[1], basis.shape[1]))] = determined
    return basis


def _row_space(A: Float[np.ndarray, "rows columns"]) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal bases of the row space and of the column space of a matrix."""
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    visible = s > TOLERANCE * s.max(initial=0.0)
    return Vt[visible].T, U[:, visible]


def everything(cell: Cell, priors: bool = True) -> Identifiability:
    """All parameters that are not fixed; raises InputError where there is no tolerance to hold one of them."""
    names = cell.robot.parameters
    free = tuple(i for i, name in enumerate(names) if name not in cell.fixed)
    loose = [names[i] for i in free if not (priors and np.isfinite(cell.prior[i]))]
    if loose:
        raise InputError(
            f"nothing is known of {', '.join(loose[:3])}{' ...' if len(loose) > 3 else ''} before the touches, so not "
            "all parameters can be estimated; write base and tool into cell.yaml and use its priors, or estimate only "
            "the identifiable ones"
        )
    return Identifiability(names, free, {})


def _conditions(
    conditions: Float[np.ndarray, "rows conditions"] | None, shape: tuple[int, ...], rng: np.random.Generator
) -> Float[np.ndarray, "poses conditions"]:
    """Conditions of the generic poses: drawn from those that there were, or directions and a span of 10 K."""
    if conditions is not None and len(conditions):
        return conditions[rng.integers(len(conditions), size=shape[0])]
    return np.column_stack([rng.choice([-1.0, 1.0], shape), rng.uniform(-5, 5, shape[0]), np.zeros(shape[0])])


def _clean(coefficient: float) -> float:
    """Without the last digits, which are rounding."""
    return float(f"{coefficient:.9g}")


def independent(
    A: Float[np.ndarray, "rows columns"], order: Sequence[int]
) -> tuple[list[int], dict[int, dict[int, float]]]:
    """Columns that no earlier one in `order` explains, and for each other its coefficients on them (rank-revealing QR).

    The order is the reader's, so pivoting is not free to choose. A column that others explain leaves its reflector to
    rounding, which takes one of the many directions that no column has: A needs many more rows than columns.
    """
    R = np.asarray(np.linalg.qr(A[:, order], mode="r"))
    lengths = np.sqrt((R * R).sum(axis=0))
    new = np.abs(np.diag(R)) > TOLERANCE * max(lengths.max(initial=0.0), 1e-300)
    basis, rest = np.asarray(order)[new].tolist(), np.asarray(order)[~new].tolist()
    C = np.linalg.lstsq(R[:, new], R[:, ~new], rcond=None)[0]
    return basis, {
        i: {k: c for k, c in zip(basis, column, strict=True) if abs(c) > 1e-7}
        for i, column in zip(rest, C.T.tolist(), strict=True)
    }


@dataclass(frozen=True)
class Sight:
    """What given touches see of the kept parameters."""

    rank: int
    lost: tuple[str, ...]  # parameters in directions that the touches do not see at all


def sight(J: Float[np.ndarray, "rows kept"], names: Sequence[str]) -> Sight:
    """Rank of a Jacobian, columns of one length: what can be told apart does not depend on what was known before."""
    _, s, Vt = np.linalg.svd(_even(J), full_matrices=True)
    rank = int((s >= UNSEEN).sum())
    return Sight(rank, _dominant(Vt[rank:], names))


def weak(G: Float[np.ndarray, "kept kept"], names: Sequence[str]) -> tuple[str, ...]:
    """Parameters in directions that touches of information G, in units of the priors, see less well than these do."""
    squares, directions = np.linalg.eigh(G)
    return _dominant(directions.T[squares < 1.0], names)


def rank_of(J: Float[np.ndarray, "rows kept"]) -> int:
    """How many directions a Jacobian sees, columns of one length."""
    return int((np.linalg.svd(_even(J), compute_uv=False) >= UNSEEN).sum())


def _even(J: Float[np.ndarray, "rows kept"]) -> Float[np.ndarray, "rows kept"]:
    """Columns of length one, or zero."""
    size = np.linalg.norm(J, axis=0)
    return np.asarray(J / np.where(size > 1e-9 * size.max(initial=0.0), size, np.inf))


def _dominant(directions: Float[np.ndarray, "directions kept"], names: Sequence[str]) -> tuple[str, ...]:
    """Names that carry more than a tenth of the square of a direction, most important first."""
    share = (directions**2).max(axis=0, initial=0.0)
    order = np.argsort(-share, kind="stable")
    return tuple(names[i] for i in order if share[i] > 0.1)


def still_joints(rows: Rows) -> dict[int, float]:
    """Joints that do not move in given touches, and where they stand."""
    spread = np.ptp(rows.q, axis=0)
    return {int(i): float(rows.q[0, i]) for i in np.flatnonzero(spread < 1e-6)}
