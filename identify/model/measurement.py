"""The one equation of a touch, and its derivative, compiled once and evaluated at all touches together."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.cell import Wire
from identify.model.compiled.batch import Mapped, compiled
from identify.model.errors import CONDITIONAL, conditions
from identify.model.kinematics import AXIS, ONE, POINT, ZERO, jig_T_tip, symbols
from identify.model.robot import Robot
from identify.model.touch import Positions, Touches

STILL = 1e-4  # [rad] or [mm] that a joint may move on the way to a touch without a direction


@dataclass(frozen=True, eq=False)
class Rows:
    """Scalar equations n . tip(q, theta) = offset + h: one a touch, three a measured position."""

    q: Float[np.ndarray, "rows joints"]  # [rad] or [mm]
    normal: Float[np.ndarray, "rows 3"]
    offset: Float[np.ndarray, " rows"]  # [mm], a ball's radius included
    radius: Float[np.ndarray, " rows"]  # [mm], of a flat wire end; 0 for points, balls and positions
    sigma: Float[np.ndarray, " rows"]  # [mm]
    ids: tuple[str, ...]  # of the touches and positions
    owner: Int[np.ndarray, " rows"]  # index into `ids`
    conditions: Float[np.ndarray, "rows conditions"] | None = None  # for error models; None: nothing was recorded
    face: tuple[str, ...] = ()  # name of the face of each row, empty if it has none; (): no row has one
    block: Int[np.ndarray, " rows"] | int = 0  # number of the table that a row comes from

    def __len__(self) -> int:
        return len(self.offset)

    def on(self, name: str) -> Bool[np.ndarray, " rows"]:
        """The rows of touches on a face."""
        return self._faces == name if self.face else np.zeros(len(self), dtype=bool)

    @cached_property
    def _faces(self) -> np.ndarray:
        return np.array(self.face, dtype=np.str_)

    def take(self, index: Int[np.ndarray, " some"] | Bool[np.ndarray, " rows"]) -> "Rows":
        """Some of the rows; ids and owners keep their meaning."""
        return Rows(
            self.q[index], self.normal[index], self.offset[index], self.radius[index], self.sigma[index],
            self.ids, self.owner[index], None if self.conditions is None else self.conditions[index],
            tuple(self._faces[index].tolist()) if self.face else (),
            self.block if isinstance(self.block, int) else self.block[index],
        )  # fmt: skip

    def distances(self, residual: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " measured"]:
        """One distance a touch or position that has rows here: the root of the sum of its squared residuals [mm]."""
        _, place = np.unique(self.owner, return_inverse=True)
        return np.sqrt(np.bincount(place, residual**2))


def rows(wire: Wire, measured: Sequence[Touches | Positions], reference: float = 20.0) -> Rows:
    """The equations of touches and positions, in their order; `reference` [degC] is the temperature of the robot."""
    parts = [_touch_rows(wire, t) if isinstance(t, Touches) else _position_rows(t) for t in measured]
    first = np.cumsum([0, *(len(table) for table in measured)])
    return Rows(
        q=np.concatenate([part.q for part in parts]),
        normal=np.concatenate([part.normal for part in parts]),
        offset=np.concatenate([part.offset for part in parts]),
        radius=np.concatenate([part.radius for part in parts]),
        sigma=np.concatenate([part.sigma for part in parts]),
        ids=tuple(name for table in measured for name in table.ids),
        owner=np.concatenate([part.owner + start for part, start in zip(parts, first[:-1], strict=True)]),
        conditions=np.concatenate([_conditions(table, reference) for table in measured]),
        face=tuple(name for table in measured for name in _faces(table)),
        block=np.repeat(np.arange(len(parts)), [len(part) for part in parts]),
    )


def _faces(measured: Touches | Positions) -> tuple[str, ...]:
    """The name of the face of every row; empty for positions."""
    return measured.face if isinstance(measured, Touches) else ("",) * (3 * len(measured))


def _conditions(measured: Touches | Positions, reference: float) -> Float[np.ndarray, "rows conditions"]:
    """Direction of every joint into a touch, and temperature above the reference; 0 where nothing was recorded."""
    if isinstance(measured, Positions):
        return np.zeros((3 * len(measured), measured.q.shape[1] + 1))
    return touch_conditions(measured.q, measured.approach, np.nan_to_num(measured.temperature - reference))


def touch_conditions(
    q: Float[np.ndarray, "rows joints"],
    approach: Float[np.ndarray, "rows joints"] | None,
    warmth: Float[np.ndarray, " rows"] | float = 0.0,
) -> Float[np.ndarray, "rows conditions"]:
    """Conditions of touches searched from an approach, so much [K] above the reference."""
    step = np.zeros_like(q) if approach is None else q - approach
    direction = np.where(np.abs(step) > STILL, np.sign(step), 0.0)  # NaN, not recorded, is not above STILL
    return np.column_stack([direction, np.broadcast_to(warmth, len(q))])


def _touch_rows(wire: Wire, touches: Touches) -> Rows:
    m = len(touches)
    offset, radius = touches.offset + wire.ball, np.full(m, wire.flat)
    return Rows(touches.q, touches.normal, offset, radius, touches.sigma, touches.ids, np.arange(m))


def _position_rows(positions: Positions) -> Rows:
    m = len(positions)
    return Rows(
        np.repeat(positions.q, 3, axis=0), np.tile(np.eye(3), (m, 1)), positions.point.ravel(), np.zeros(3 * m),
        np.repeat(positions.sigma, 3), positions.ids, np.repeat(np.arange(m), 3),
    )  # fmt: skip


class MeasurementModel:
    """Residuals r = n . tip(q, theta) - c - h and their Jacobian by theta.

    h = radius sqrt(1 - (n . a)^2) is the extent along the normal of a flat wire end whose axis is a; a ball's extent
    is its radius, a point's 0.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._q, self._theta = symbols(robot)
        self._normal, self._offset = ca.SX.sym("normal", 3), ca.SX.sym("offset")
        self._radius = ca.SX.sym("radius")
        self._made = conditions(robot) if set(robot.errors) & CONDITIONAL else None

    @property
    def conditional(self) -> bool:
        """Whether touches depend on how they were made."""
        return self._made is not None

    def _tip(self, M: ca.SX, w: ca.SX) -> ca.SX:
        return jig_T_tip(self.robot, self._q, self._theta, M, w, self._made)

    def _residual(self, flat: bool) -> ca.SX:
        r = ca.dot(self._normal, self._tip(POINT, ONE)) - self._offset
        if flat:
            lean = ca.dot(self._normal, self._tip(AXIS, ZERO))
            r -= self._radius * ca.sqrt(ca.fmax(1 - lean**2, 1e-12))  # its slope is infinite where the wire is upright
        return r

    def _compiled(self, flat: bool) -> Mapped:
        r = self._residual(flat)
        inputs = {"q": self._q, "theta": self._theta, "normal": self._normal, "offset": self._offset}
        inputs |= {} if self._made is None else {"conditions": self._made}
        return compiled(
            "residual",
            inputs | ({"radius": self._radius} if flat else {}),
            {"r": r, "J": ca.gradient(r, self._theta)},
        )

    @cached_property
    def _pointed(self) -> Mapped:
        return self._compiled(flat=False)

    @cached_property
    def _flat(self) -> Mapped:
        """With the extent of the wire's end: twice the operations."""
        return self._compiled(flat=True)

    def residual(self, theta: Float[np.ndarray, " parameters"], rows: Rows) -> Float[np.ndarray, " rows"]:
        """Distances of the tip from the planes [mm]."""
        return self.linearize(theta, rows)[0]

    def linearize(
        self, theta: Float[np.ndarray, "*robots parameters"], rows: Rows
    ) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, "rows parameters"]]:
        """Residuals [mm] and their Jacobian by all parameters [mm/mm, mm/rad]; `theta` of one robot or of one a row."""
        columns = [rows.q, theta, rows.normal, rows.offset[:, None]]
        if self._made is not None:
            unknown = np.zeros((len(rows), len(self.robot.joints) + 1))
            columns.append(unknown if rows.conditions is None else rows.conditions)
        r, J = self._flat(*columns, rows.radius[:, None]) if rows.radius.any() else self._pointed(*columns)
        return r, J


@lru_cache(maxsize=32)
def measurement_model(robot: Robot) -> MeasurementModel:
    """The measurement model of a robot, compiled once for all who ask."""
    return MeasurementModel(robot)


def tip_rows(q: Float[np.ndarray, "poses joints"], sigma: float = 1.0) -> Rows:
    """Three rows a pose along x, y and z through the origin: the tip position itself as a residual."""
    ids = tuple(str(i) for i in range(len(q)))
    return rows(Wire(0.0, "point"), [Positions(ids, q, np.zeros((len(q), 3)), np.full(len(q), sigma))])
