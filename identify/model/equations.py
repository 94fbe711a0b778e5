"""Equations of measurements in CasADi symbols, compiled once and evaluated at all rows together."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Int

from identify.model.compiled.batch import Mapped, compiled
from identify.model.joint_error_models import CONDITIONAL, FURTHER, conditions
from identify.model.kinematics import AXIS, ONE, POINT, ZERO, jig_T_tip, symbols
from identify.model.robot import Robot

LEVER = 100.0  # [mm] at which a turn of a measured pose counts as a distance
SHORTEST = 1e-3  # [mm], below which a distance has no direction


@dataclass(frozen=True, eq=False)
class Rows:
    """Scalar equations, one a touch or a distance, three a measured position or a contact, six a pose.

    Most are planes: n . tip(q, theta) = offset + h. The others are named in `equation`, see EQUATIONS.
    """

    q: Float[np.ndarray, "rows joints"]  # [rad] or [mm]
    normal: Float[np.ndarray, "rows 3"]
    offset: Float[np.ndarray, " rows"]  # [mm], a ball's radius included
    radius: Float[np.ndarray, " rows"]  # [mm], of a flat wire end; 0 for points, balls and positions
    sigma: Float[np.ndarray, " rows"]  # [mm]; infinite for a row that counts nothing
    ids: tuple[str, ...]  # of the touches and positions
    owner: Int[np.ndarray, " rows"]  # index into `ids`
    conditions: Float[np.ndarray, "rows conditions"] | None = None  # for error models; None: nothing was recorded
    face: tuple[str, ...] = ()  # name of the face of each row, empty if it has none; (): no row has one
    equation: tuple[str, ...] = ()  # of EQUATIONS; (): all are planes
    point: tuple[str, ...] = ()  # name of the point in the equation of each row, empty if it has none
    second: tuple[str, ...] = ()  # name of the other point of a spacing
    places: Float[np.ndarray, "rows 6"] | None = None  # [mm], coordinates of both points
    turn: Float[np.ndarray, "rows 9"] | None = None  # measured rotation of a pose, row by row
    placement: tuple[str, ...] = ()  # name of the further stand of each row, empty for the jig's own; (): all there
    tool: tuple[str, ...] = ()  # name of the further tool of each row, empty for the tool of the cell; (): all that

    def __len__(self) -> int:
        return len(self.offset)

    def on(self, name: str) -> Bool[np.ndarray, " rows"]:
        """The rows of touches on a face."""
        return self.named("face", name)

    def named(self, column: str, name: str) -> Bool[np.ndarray, " rows"]:
        """The rows in which a column of names holds a name."""
        names = self._names[column]
        return names == name if len(names) else np.zeros(len(self), dtype=bool)

    @cached_property
    def _names(self) -> dict[str, np.ndarray]:
        columns = ("face", "equation", "point", "second", "placement", "tool")
        return {column: np.array(getattr(self, column), dtype=np.str_) for column in columns}

    def take(self, index: Int[np.ndarray, " some"] | Bool[np.ndarray, " rows"]) -> "Rows":
        """Some of the rows; ids and owners keep their meaning."""
        names = self._names.items()
        columns: dict[str, Any] = {column: tuple(of[index].tolist()) for column, of in names if len(of)}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                columns[field.name] = value[index]
        return replace(self, **columns)

    @property
    def counted(self) -> Bool[np.ndarray, " rows"]:
        """Rows of finite scatter."""
        return np.isfinite(self.sigma)

    def distances(self, residual: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " measured"]:
        """One distance a measurement that has rows here: the root of the sum of its squared residuals [mm]."""
        _, place = np.unique(self.owner, return_inverse=True)
        return np.sqrt(np.bincount(place, residual**2))


@dataclass(frozen=True, eq=False)
class Arm:
    """What an equation may use: the tip, and the numbers of a row, as symbols."""

    tip: Callable[[ca.SX, ca.SX], ca.SX]  # carries a point or a direction from the tip to the jig frame
    normal: ca.SX
    offset: ca.SX
    radius: ca.SX
    places: ca.SX
    turn: ca.SX


def plane(arm: Arm) -> ca.SX:
    """Plane n . tip - c: the tip meets a plane."""
    return ca.dot(arm.normal, arm.tip(POINT, ONE)) - arm.offset


def flat(arm: Arm) -> ca.SX:
    """The same with the extent h = radius sqrt(1 - (n . a)^2) of a flat wire end whose axis is a."""
    lean = ca.dot(arm.normal, arm.tip(AXIS, ZERO))
    return plane(arm) - arm.radius * ca.sqrt(
        ca.fmax(1 - lean**2, 1e-12)
    )  # its slope is infinite if the wire is upright


def contact(arm: Arm) -> ca.SX:
    """Contact n . (tip - p): the tip is in a point."""
    return ca.dot(arm.normal, arm.tip(POINT, ONE) - arm.places[:3])


def distance(arm: Arm) -> ca.SX:
    """|tip - p| - d: the tip is at a distance from a point."""
    return _length(arm.tip(POINT, ONE) - arm.places[:3]) - arm.offset


def spacing(arm: Arm) -> ca.SX:
    """|a - b| - d: two points are at a distance."""
    return _length(arm.places[:3] - arm.places[3:]) - arm.offset


def turn(arm: Arm) -> ca.SX:
    """L n . vee((R M' - M R') / 2): the turn from the measured rotation M to R, as a distance at a lever L."""
    axes = [arm.tip(ca.SX(np.eye(3)[:, k]), ZERO) for k in range(3)]
    E = ca.horzcat(*axes) @ ca.reshape(arm.turn, 3, 3)  # column by column: the measured rotation, transposed
    return LEVER * ca.dot(arm.normal, ca.vertcat(E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1])) / 2


def _length(v: ca.SX) -> ca.SX:
    return ca.sqrt(ca.sumsqr(v) + SHORTEST**2)


EQUATIONS: dict[str, Callable[[Arm], ca.SX]] = {
    "plane": plane,
    "flat": flat,
    "contact": contact,
    "distance": distance,
    "spacing": spacing,
    "turn": turn,
}
"""Residuals [mm] by the names that rows use; planes are flat where the wire's end is."""


class MeasurementModel:
    """Residuals of rows and their Jacobian by theta."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._made = conditions(robot) if set(robot.errors) & CONDITIONAL else None
        self._functions: dict[str, Mapped] = {}

    def _compiled(self, name: str) -> Mapped:
        """An equation and its derivatives, compiled when first asked for, of the numbers that it uses."""
        if name not in self._functions:
            q, theta = symbols(self.robot)
            every = {key: ca.SX.sym(key, size) for key, size in INPUTS.items()}
            tip = lambda M, w: jig_T_tip(self.robot, q, theta, M, w, self._made)  # noqa: E731
            r = EQUATIONS[name](Arm(tip, **every))
            inputs = {key: symbol for key, symbol in every.items() if ca.depends_on(r, symbol)}
            conditions = {} if self._made is None else {"conditions": self._made}
            outputs = {"r": r, "J": ca.gradient(r, theta)}
            if "places" in inputs:
                outputs["P"] = ca.gradient(r, every["places"])
            self._functions[name] = compiled("residual", {"q": q, "theta": theta} | inputs | conditions, outputs)
        return self._functions[name]

    def residual(self, theta: Float[np.ndarray, " parameters"], rows: Rows) -> Float[np.ndarray, " rows"]:
        """Residuals [mm]."""
        return self.linearize(theta, rows)[0]

    def linearize(
        self, theta: Float[np.ndarray, "*robots parameters"], rows: Rows
    ) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, "rows parameters"]]:
        """Residuals [mm] and their Jacobian by all parameters [mm/mm, mm/rad]; `theta` of one robot or of one a row."""
        return self.linearize_with_points(theta, rows)[:2]

    def linearize_with_points(
        self, theta: Float[np.ndarray, "*robots parameters"], rows: Rows
    ) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, "rows parameters"], Float[np.ndarray, "rows 6"]]:
        """The same, and the derivatives by the coordinates of the points in the equations [mm/mm]."""
        if not rows.equation:
            r, J = self._evaluate("flat" if rows.radius.any() else "plane", theta, rows)[:2]
            return r, J, np.zeros((len(r), 6))
        r, J, P = np.empty(len(rows)), np.empty((len(rows), theta.shape[-1])), np.zeros((len(rows), 6))
        for name in dict.fromkeys(rows.equation):
            index = rows.named("equation", name)
            part = replace(rows.take(index), equation=())
            name = "flat" if name == "plane" and part.radius.any() else name
            of_part = self._evaluate(name, theta if theta.ndim == 1 else theta[index], part)
            r[index], J[index] = of_part[:2]
            if len(of_part) > 2:
                P[index] = of_part[2]
        return r, J, P

    def _evaluate(self, name: str, theta: np.ndarray, rows: Rows) -> tuple[np.ndarray, ...]:
        function = self._compiled(name)
        row = {"q": rows.q, "theta": theta, "normal": rows.normal, "offset": rows.offset[:, None]}
        row["radius"] = rows.radius[:, None]
        further = {"places": rows.places, "turn": rows.turn, "conditions": rows.conditions}
        row |= {key: column for key, column in further.items() if column is not None}
        if rows.conditions is None:
            row["conditions"] = np.zeros((len(rows), len(self.robot.joints) + FURTHER))
        return function(*(row[key] for key in function.names))


INPUTS = {"normal": 3, "offset": 1, "radius": 1, "places": 6, "turn": 9}  # of a row, and their sizes


@lru_cache(maxsize=32)
def measurement_model(robot: Robot) -> MeasurementModel:
    """The measurement model of a robot, compiled once for all who ask."""
    return MeasurementModel(robot)
