"""Everything that may differ from the drawing and the files: one vector x in units of prior standard deviations."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from identify.model.cell import Cell
from identify.model.jig import Face
from identify.model.measurement import Rows, measurement_model
from identify.uncertainty.named_unknowns import Named, columns, named, placed

STICKOUT = 2.0  # [mm], 1 sigma by which a wire that was cut sticks out more or less than before
DRIFT = 1.0  # [mm], 1 sigma by which the tip moves against the jig while it is measured, where it does


@dataclass(frozen=True, eq=False)
class Contacts:
    """The rows of measurements, and where the tip was by some parameters."""

    rows: Rows
    cell: Cell
    theta: Float[np.ndarray, " parameters"]  # [mm, rad]

    @cached_property
    def tip(self) -> tuple[Float[np.ndarray, "rows 3"], Float[np.ndarray, "rows 3 3"]]:
        """Positions [mm] and rotations of the tip in the jig frame."""
        position, rotation = self.cell.kinematics.tip(self.rows.q, self.theta)
        return position, rotation


@dataclass(frozen=True, eq=False)
class Shared:
    """An unknown beside the robot's parameters that several measurements share; residuals are linear in it."""

    name: str
    unit: Literal["mm", "deg"]
    scale: float  # [mm] or [rad], 1 sigma of the prior, or the unit of an unknown without one
    precision: float  # 1, or 0 if nothing is known before the measurements
    slope: Callable[[Contacts], Float[np.ndarray, " rows"]]  # d residual / d unknown, [mm/mm] or [mm/rad]


def face_offset(face: Face) -> Shared:
    """The distance b by which a face stands outside of its place on the drawing: r = n . tip - c - b - h."""
    return Shared(f"face.{face.name}", "mm", face.tolerance, 1.0, lambda at: -1.0 * at.rows.on(face.name))


def face_tilts(face: Face) -> Iterator[Shared]:
    """The angles by which a face leans outwards along u and along v, about its middle."""
    for axis, side, length in zip("uv", (face.u, face.v), face.size, strict=True):
        unit = side / length

        def slope(at: Contacts, unit: np.ndarray = unit) -> Float[np.ndarray, " rows"]:
            middle = face.origin + (face.u + face.v) / 2
            return -((at.tip[0] - middle) @ unit) * at.rows.on(face.name)

        yield Shared(f"face.{face.name}.tilt_{axis}", "deg", face.tilt, 1.0, slope)


def stickout(name: str, first: int) -> Shared:
    """The length by which the wire sticks out more from a touch on, the `first` of the measurements, than before."""

    def slope(at: Contacts) -> Float[np.ndarray, " rows"]:
        along = np.einsum("ij,ij->i", at.rows.normal, at.tip[1][:, :, 2])
        return along * (at.rows.owner >= first)

    return Shared(f"stickout.{name}", "mm", STICKOUT, 1.0, slope)


def drift(time: Float[np.ndarray, " measured"]) -> tuple[Shared, ...]:
    """The way of the tip along x, y and z of the jig while `time` grows by 1; at time 0 there is none."""

    def along(axis: int) -> Shared:
        return Shared(
            f"drift.{'xyz'[axis]}", "mm", DRIFT, 1.0, lambda at: at.rows.normal[:, axis] * time[at.rows.owner]
        )

    return tuple(along(axis) for axis in range(3))


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Names and scales of all unknowns: parameters of the robot in their order, then what measurements share.

    x = 0 is the drawing. A prior of an unknown is the standard normal distribution, or none (precision 0).
    """

    cell: Cell
    parameters: Int[np.ndarray, " some"]  # places of the first unknowns among the parameters of the robot
    shared: tuple[Shared, ...] = ()
    named: tuple[Named, ...] = ()  # frames and points, which residuals are not linear in

    @classmethod
    def of(cls, cell: Cell, further: Sequence[Shared] = ()) -> "Unknowns":
        """The unknowns of a cell: each parameter and face that has a tolerance or is to be fitted, and `further`."""
        fixed = np.array([name in cell.fixed for name in cell.robot.parameters])
        faces = () if cell.jig is None else cell.jig.faces
        offsets = (face_offset(face) for face in faces if face.tolerance > 0)
        tilts = (tilt for face in faces if face.tilt > 0 for tilt in face_tilts(face))
        return cls(cell, np.flatnonzero(~fixed & (cell.prior > 0)), (*offsets, *tilts, *further), tuple(named(cell)))

    def __len__(self) -> int:
        return len(self.parameters) + len(self.shared) + sum(len(unknown.nominal) for unknown in self.named)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all unknowns."""
        parameters = (self.cell.robot.parameters[i] for i in self.parameters)
        further = (name for unknown in self.named for name in unknown.names)
        return (*parameters, *(shared.name for shared in self.shared), *further)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """The unit of each unknown in files and on screens."""
        further = (unit for unknown in self.named for unit in unknown.units)
        parameters = (self.cell.robot.units[i] for i in self.parameters)
        return (*parameters, *(shared.unit for shared in self.shared), *further)

    @cached_property
    def scale(self) -> Float[np.ndarray, " unknowns"]:
        """One unit of each coordinate of x [mm], [rad] or the inside unit of a joint error."""
        further = (unknown.scale for unknown in self.named)
        return np.concatenate([self.cell.scale[self.parameters], [shared.scale for shared in self.shared], *further])

    @cached_property
    def precision(self) -> Float[np.ndarray, " unknowns"]:
        """Of the prior: 1, or 0 for what is to be fitted."""
        free = np.isinf(self.cell.prior[self.parameters])
        further = (np.full(len(unknown.nominal), unknown.precision) for unknown in self.named)
        return np.concatenate([np.where(free, 0.0, 1.0), [shared.precision for shared in self.shared], *further])

    @cached_property
    def origin(self) -> Float[np.ndarray, " unknowns"]:
        """Values [mm, rad] at x = 0."""
        nominal = (unknown.nominal for unknown in self.named)
        return np.concatenate([self.cell.theta[self.parameters], np.zeros(len(self.shared)), *nominal])

    def index(self, names: Sequence[str]) -> list[int]:
        """Places of some unknowns; raises KeyError if one is not among them."""
        place = {name: i for i, name in enumerate(self.names)}
        return [place[name] for name in names]

    def theta(self, x: Float[np.ndarray, "*robots unknowns"]) -> Float[np.ndarray, "*robots parameters"]:
        """Parameters of the robot [mm, rad] at x."""
        theta = np.tile(self.cell.theta, (*x.shape[:-1], 1))
        theta[..., self.parameters] += (x * self.scale)[..., : len(self.parameters)]
        return theta

    def linearize(
        self, x: Float[np.ndarray, " unknowns"], rows: Rows, theta: Float[np.ndarray, " parameters"] | None = None
    ) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, "rows unknowns"]]:
        """Residuals [mm] at x, and their Jacobian by x [mm]; `theta` holds parameters that are no unknowns as well."""
        theta = self.theta(x) if theta is None else theta
        r, J = self._linearized(theta, rows, x)
        first, last = len(self.parameters), len(self.parameters) + len(self.shared)
        return r + J[:, first:last] @ x[first:last], J

    def rows(
        self, rows: Rows, theta: Float[np.ndarray, " parameters"] | None = None
    ) -> Float[np.ndarray, "rows unknowns"]:
        """Whitened rows: derivatives of residuals by x in units of the sensor's scatter, at a robot or the drawing.

        Offsets of faces are columns of their own, so that all touches on a face share one.
        """
        theta = self.cell.theta if theta is None else theta
        return self._linearized(theta, rows, np.zeros(len(self)))[1] / rows.sigma[:, None]

    def _linearized(
        self, theta: Float[np.ndarray, " parameters"], rows: Rows, x: Float[np.ndarray, " unknowns"]
    ) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, "rows unknowns"]]:
        """Residuals [mm] without the part of what is linear, and the Jacobian by x [mm]."""
        if not self.named:
            r, J = measurement_model(self.cell.robot).linearize(theta, rows)
            return r, np.hstack([self._scaled(J), self.shared_slopes(rows, theta)])
        each, rows = placed(theta, rows, self.values(x))
        r, J, further = self._by_named(each, rows)
        return r, np.hstack([self._scaled(J), self.shared_slopes(rows, theta), further])

    def each(self, x: Float[np.ndarray, " unknowns"], rows: Rows) -> tuple[Float[np.ndarray, "*rows parameters"], Rows]:
        """Parameters of each row with its own base and tool [mm, rad], and the rows with their points, at x."""
        return placed(self.theta(x), rows, self.values(x))

    def slopes_at(self, each: Float[np.ndarray, "rows parameters"], rows: Rows) -> Float[np.ndarray, "rows unknowns"]:
        """Derivatives of residuals by x [mm] for rows that have parameters of their own; 0 for what is linear."""
        _, J, further = self._by_named(each, rows)
        return np.hstack([self._scaled(J), np.zeros((len(J), len(self.shared))), further])

    def _by_named(
        self, each: Float[np.ndarray, "*rows parameters"], rows: Rows
    ) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, "rows parameters"], Float[np.ndarray, "rows further"]]:
        """Residuals [mm], and their derivatives by the robot's own parameters and by frames and points."""
        r, J, P = measurement_model(self.cell.robot).linearize_with_points(each, rows)
        further = [columns(unknown, rows, J, P) * unknown.scale for unknown in self.named]
        return r, J, np.hstack(further)

    def values(self, x: Float[np.ndarray, " unknowns"]) -> list[tuple[Named, np.ndarray]]:
        """Frames and points with their coordinates [mm, rad] at x."""
        start, out = len(self.parameters) + len(self.shared), []
        for unknown in self.named:
            part = x[start : start + len(unknown.nominal)]
            out.append((unknown, unknown.nominal + unknown.scale * part))
            start += len(part)
        return out

    def tip_rows(
        self, q: Float[np.ndarray, "poses joints"], theta: Float[np.ndarray, " parameters"] | None = None
    ) -> Float[np.ndarray, "poses 3 unknowns"]:
        """Derivatives of the tip position by x [mm], at a robot or the drawing; 0 for what only measurements share."""
        theta = self.cell.theta if theta is None else theta
        J = self._scaled(self.cell.kinematics.tip_jacobian(q, theta)[1])
        return np.concatenate([J, np.zeros((*J.shape[:2], len(self) - J.shape[2]))], axis=2)

    def _scaled(self, J: Float[np.ndarray, "*rows parameters"]) -> Float[np.ndarray, "*rows some"]:
        return np.asarray(J[..., self.parameters] * self.cell.scale[self.parameters])

    def shared_slopes(self, rows: Rows, theta: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, "rows shared"]:
        """Derivatives of residuals by what measurements share, in units of its priors [mm]."""
        at, K = Contacts(rows, self.cell, theta), np.zeros((len(rows), len(self.shared)))
        for k, shared in enumerate(self.shared):
            K[:, k] = shared.scale * shared.slope(at)
        return K
