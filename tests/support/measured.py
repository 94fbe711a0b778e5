"""What a robot with known parameters would measure: planes and positions through its true tip, with noise."""

import numpy as np

from identify.model.cell import Cell
from identify.model.measurement import measurement_model, rows
from identify.model.touch import HIT, Positions, Touches

TABLE_2 = {
    "base.x": 339.106,
    "base.y": 740.678,
    "base.z": 351.276,
    "base.rz": -92.350,
    "base.ry": 0.128,
    "base.rx": -0.244,
    "j1.alpha": -90.216,
    "j1.beta": -0.007,
    "j2.theta": -91.337,
    "j2.alpha": 1.199,
    "j2.a": 354.447,
    "j2.beta": 0.123,
    "j3.theta": 0.536,
    "j3.alpha": -90.742,
    "j4.theta": 0.710,
    "j4.alpha": 89.291,
    "j4.d": 353.239,
    "j4.a": 1.821,
    "j5.theta": 0.307,
    "j5.alpha": -89.705,
    "tool.x": -2.895,
    "tool.y": 7.636,
    "tool.z": 411.267,
}


def table_2(cell: Cell) -> np.ndarray:
    """The robot that the paper identified (its Table 2), written here apart from the library's truth file."""
    theta = cell.theta.copy()
    for name, value in TABLE_2.items():
        i = cell.robot.parameters.index(name)
        theta[i] = value * cell.robot.parameter_unit()[i]
    return theta


def poses_over_jig(cell: Cell, count: int, rng: np.random.Generator) -> np.ndarray:
    """Joint values whose nominal tip lies in the zone with the torch pointing down, drawn until there are enough."""
    found: list[np.ndarray] = []
    while sum(map(len, found)) < count:
        q = rng.uniform(0.6 * cell.robot.lower, 0.6 * cell.robot.upper, (20_000, len(cell.robot.joints)))
        p, R = cell.kinematics.tip(q, cell.theta)
        inside = ((p > cell.zone.box[:, 0]) & (p < cell.zone.box[:, 1])).all(axis=1)
        found.append(q[inside & (R[:, 2, 2] < -np.cos(cell.zone.max_tilt))])
    return np.concatenate(found)[:count]


def touches_at(cell: Cell, theta: np.ndarray, q: np.ndarray, rng: np.random.Generator, sigma: float = 0.05) -> Touches:
    """Touches of planes across x, y and z in turn that stand where the true tip is, but for noise."""
    m = len(q)
    normal = np.eye(3)[np.arange(m) % 3]
    blank = Touches(
        tuple(f"t{i + 1}" for i in range(m)),
        ("",) * m,
        q,
        normal,
        np.zeros(m),
        np.full(m, sigma),
        (HIT,) * m,
        np.full(m, np.nan),
        ("",) * m,
        ("",) * m,
    )
    where = measurement_model(cell.robot).residual(theta, rows(cell.wire, [blank]))
    return with_offsets(blank, where + sigma * rng.standard_normal(m))


def with_offsets(touches: Touches, offset: np.ndarray) -> Touches:
    """The same touches on planes at other offsets."""
    columns = {name: getattr(touches, name) for name in touches.__dataclass_fields__}
    return Touches(**(columns | {"offset": offset}))


def positions_at(
    cell: Cell, theta: np.ndarray, q: np.ndarray, rng: np.random.Generator, sigma: float = 0.05
) -> Positions:
    """Measured positions of the true tip."""
    point = cell.kinematics.tip(q, theta)[0] + sigma * rng.standard_normal((len(q), 3))
    return Positions(tuple(f"p{i + 1}" for i in range(len(q))), q, point, np.full(len(q), sigma))


def touches_anywhere(cell, count=30, seed=4):
    """Postures all over the joint range, each called a touch of some face: rows are linear in what matters here."""
    rng, robot = np.random.default_rng(seed), cell.robot
    faces = rng.choice(list(cell.jig.by_name), count)
    chosen = [cell.jig.by_name[name] for name in faces]
    blank = ("",) * count
    return Touches(
        tuple(map(str, range(count))),
        tuple(faces.tolist()),
        rng.uniform(robot.lower, robot.upper, (count, 6)),
        np.stack([f.normal for f in chosen]),
        np.array([f.offset for f in chosen]),
        np.full(count, 0.05),
        ("hit",) * count,
        np.zeros(count),
        blank,
        blank,
    )
