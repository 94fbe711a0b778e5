"""A robot identified: its parameters, their covariance, how well it fits, and what was found on the way."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell

FACE = "face."  # before the name of a face in the name of its offset


@dataclass(frozen=True)
class Errors:
    """Sizes of errors: distances along the normal for touches, in space for positions."""

    n: int
    mean_mm: float
    rms_mm: float
    p95_mm: float
    max_mm: float


def summarize(distance: Float[np.ndarray, " measured"]) -> Errors:
    """Number, mean, root mean square, 95th percentile and maximum of distances [mm]."""
    d = np.abs(distance)
    return Errors(len(d), *(float(v) for v in (d.mean(), np.sqrt(np.mean(d * d)), np.percentile(d, 95), d.max())))


@dataclass(frozen=True)
class Residual:
    """What one touch said before and after the identification."""

    before_mm: float
    after_mm: float
    used: bool


@dataclass(frozen=True)
class Term:
    """An error model on the way from the geometric robot to the richest, and what it buys at unseen touches."""

    name: str
    held_out_mm: float
    """Mean error in regions held out, with this model and those before it."""
    gain_mm: float
    """By which that is less than without it."""
    standard_error_mm: float
    """Of the gain."""
    kept: bool


@dataclass(frozen=True)
class Finding:
    """Something wrong with what was measured, or with the robot: what kind, the evidence in a sentence, and where."""

    kind: str
    text: str
    ids: tuple[str, ...] = ()


@dataclass(frozen=True)
class SharedValue:
    """What several measurements share, as it was estimated: the offset of a face, the length of a wire."""

    name: str
    unit: Literal["mm", "deg"]
    value: float
    """[mm] or [rad]."""
    scale: float
    """[mm] or [rad], 1 sigma of the prior."""

    @property
    def inside(self) -> float:
        """One unit of files, in mm or rad."""
        return float(np.radians(1.0)) if self.unit == "deg" else 1.0


@dataclass(frozen=True)
class Discrepancy:
    """How far this arm is from what was stated: factors on the noise and on the priors."""

    noise: float
    """Of the rows, in units of the stated sigma."""
    geometry: float = 1.0
    """On the priors of base, tool and links."""
    errors: float = 1.0
    """On the priors of the joint errors."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """A robot identified: its parameters, their covariance, and how far to trust them."""

    cell: Cell
    """As it was used, with the joint errors that were chosen."""
    theta: Float[np.ndarray, " parameters"]
    """[mm, rad]."""
    start: Float[np.ndarray, " parameters"]
    """[mm, rad], nominal, or fitted in closed form where the cell says so."""
    estimated: tuple[str, ...]
    """Names of the parameters that the measurements and the priors determine, in the order of `covariance`."""
    combinations: Mapping[str, Mapping[str, float]]
    """Eliminated name -> {estimated name: coefficient}, file units."""
    covariance: Float[np.ndarray, "estimated estimated"]
    """[mm, rad]."""
    scatter: float
    """Residuals in units of the stated sigma; where above 1, the covariance is widened by it."""
    scatter_significant: bool
    """Whether chance does not explain its distance from 1 (chi-square, 1 %)."""
    weak: tuple[str, ...]
    """Names of estimated parameters that the measurements hardly tell more of than their priors."""
    outliers: Mapping[str, float]
    """Id -> residual [mm]."""
    fit: Errors
    """At the measurements used: no accuracy, since the fit has seen them."""
    held_out: Errors | None
    """None where no region could be spared."""
    residuals: Mapping[str, Residual]
    """By id, before and after."""
    fingerprints: frozenset[str]
    """Of the measurements used, so that they are not used again to verify."""
    iterations: int
    """Of Ipopt."""
    solve_s: float
    """[s] that Ipopt took."""
    choice: tuple[Term, ...] = ()
    """Of the error models, where the data chose them."""
    findings: tuple[Finding, ...] = ()
    """What is wrong with measurements or robot, in sentences."""
    inputs: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the files it was made from."""
    shared: tuple[SharedValue, ...] = ()
    """Beside the parameters."""
    shared_covariance: Float[np.ndarray, "shared unknowns"] = field(default_factory=lambda: np.empty((0, 0)))
    """Rows of the joint covariance [mm, rad]."""
    discrepancy: Discrepancy | None = None
    """None: of a file of the first version."""
    promise: Mapping[str, float] | None = None
    """Rms_mm and p95_mm in the weld zone; None if there is no zone."""
    spans: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Where data was: joints and tip, file units."""

    def __repr__(self) -> str:
        promise = "none" if self.promise is None else f"{self.promise['p95_mm']:.3f} mm at 95 % of the weld zone"
        return (
            f"<Calibration of {self.cell.robot.name}: {len(self.estimated)} of {len(self.theta)} parameters from "
            f"{len(self.residuals)} measurements, fit {self.fit.rms_mm:.3f} mm RMS, promise {promise}>"
        )

    @cached_property
    def index(self) -> list[int]:
        """Places of the estimated parameters among all."""
        return [self.cell.robot.parameters.index(name) for name in self.estimated]

    @cached_property
    def sigma(self) -> Float[np.ndarray, " parameters"]:
        """Standard deviations of all parameters [mm, rad]; 0 where a parameter was not estimated."""
        sigma = np.zeros(len(self.theta))
        sigma[self.index] = np.sqrt(np.diag(self.covariance))
        return sigma

    @property
    def noise(self) -> float:
        """Scatter of a measurement in units of its stated sigma."""
        if self.discrepancy is not None:
            return self.discrepancy.noise
        return max(1.0, self.scatter if self.scatter_significant else 1.0)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all that was estimated: parameters, then what measurements share."""
        return (*self.estimated, *(shared.name for shared in self.shared))

    @cached_property
    def values(self) -> Float[np.ndarray, " unknowns"]:
        """Values of all that was estimated [mm, rad]."""
        return np.concatenate([self.theta[self.index], [shared.value for shared in self.shared]])

    @cached_property
    def joint_covariance(self) -> Float[np.ndarray, "unknowns unknowns"]:
        """Covariance of the estimated parameters and of what measurements share [mm, rad]."""
        if not self.shared:
            return self.covariance
        across = self.shared_covariance[:, : len(self.estimated)]
        return np.block([[self.covariance, across.T], [self.shared_covariance]])

    @property
    def named(self) -> tuple[tuple[SharedValue, float], ...]:
        """Further placements, tools and points with the standard deviation of each coordinate [mm] or [rad]."""
        sigma = np.sqrt(np.diag(self.joint_covariance))[len(self.estimated) :].tolist()
        some = zip(self.shared, sigma, strict=True)
        return tuple(pair for pair in some if pair[0].name.startswith(("placement.", "tool.", "point.")))

    def status(self, name: str) -> Literal["estimated", "eliminated", "fixed"]:
        """What became of a parameter."""
        if name in self.estimated:
            return "estimated"
        return "eliminated" if name in self.combinations else "fixed"

    def tip_covariance(self, q: Float[np.ndarray, "poses joints"]) -> Float[np.ndarray, "poses 3 3"]:
        """Covariance of the tip position at poses [mm^2]."""
        J = self.cell.kinematics.tip_jacobian(q, self.theta)[1][:, :, self.index]
        return J @ self.covariance @ J.transpose(0, 2, 1)


def coordinates(
    cell: Cell, theta: Float[np.ndarray, " parameters"], q: Float[np.ndarray, "rows joints"]
) -> dict[str, Float[np.ndarray, " rows"]]:
    """Joint values and tip positions in file units, by name."""
    tip = cell.kinematics.tip(q, theta)[0]
    joints = zip(cell.robot.joints, (q / cell.robot.joint_unit()).T, strict=True)
    names = {f"{joint.name} {'mm' if joint.prismatic else 'deg'}": value for joint, value in joints}
    return names | {f"{axis} mm": value for axis, value in zip("xyz", tip.T, strict=True)}


def fingerprints(*columns: Float[np.ndarray, "rows _"]) -> list[str]:
    """A short name for each measurement, made of its numbers to 1e-6, which a rewriting of the file does not change."""
    numbers = np.column_stack(columns).round(6) + 0.0  # no negative zeros
    return [hashlib.sha256(row.tobytes()).hexdigest()[:16] for row in numbers]
