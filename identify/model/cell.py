"""The cell: a robot, the jig before it, where it stands, what it carries, and how it touches."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError, nearest
from identify.model.jig import Jig
from identify.model.kinematics import Kinematics, shared_kinematics
from identify.model.robot import Robot
from identify.model.shape import Shape

NECK = 110.0  # [mm] behind the tip, where the nozzle of a torch meets its body and the neck bends
PIN = 56.0  # [mm], a shorter tool is no torch
DEG = np.pi / 180


@dataclass(frozen=True)
class Wire:
    """The end of the welding wire."""

    radius: float = 0.6  # [mm]
    shape: Literal["point", "ball", "flat"] = "flat"

    @property
    def ball(self) -> float:
        """What a round end adds to the distance of the tip from a face, whichever way it leans [mm]."""
        return self.radius if self.shape == "ball" else 0.0

    @property
    def flat(self) -> float:
        """The radius of a flat end, which counts by the sine of its lean; 0 of other ends [mm]."""
        return self.radius if self.shape == "flat" else 0.0


@dataclass(frozen=True)
class TouchSettings:
    """How touches are made."""

    sigma: float = 0.05  # [mm], scatter of one touch along the normal
    approach: float = 25.0  # [mm] before the contact
    travel: float = 60.0  # [mm], longest search from the approach
    speed: float = 5.0  # [mm/s] of the search
    max_tilt: float = 50 * DEG  # [rad] between wire and face normal


@dataclass(frozen=True, eq=False)
class Zone:
    """Where accuracy counts: the tip in a box of the jig frame, the torch near straight down."""

    box: Float[np.ndarray, "3 2"]  # [mm]
    max_tilt: float = 60 * DEG  # [rad]


@dataclass(frozen=True)
class Priors:
    """Manufacturing and set-up tolerances, 1 sigma."""

    base: tuple[float, float] = (10.0, 2 * DEG)  # [mm], [rad]
    tool: tuple[float, float] = (10.0, 2 * DEG)
    link: tuple[float, float] = (3.0, 1 * DEG)
    errors: Mapping[str, float] = field(default_factory=dict)  # file units, by keys of SIZES; those not here are usual


# Slamani, Nubiola and Bonev (2012), Assessment of the positioning performance of an industrial robot, find an ABB
# IRB 1600 before calibration off by up to 0.65 mm along lines and 2.8 mrad: lengths and angles of this size give that.
CATALOGUE = 0.5, 0.05 * DEG  # [mm], [rad], 1 sigma of the links of an industrial arm that is built by its drawing
# Base and tool as the pendant of such an arm teaches them: the jig as a user frame of three points, the tip of the wire
# by four postures at one point. Points are met to 1 or 2 mm by eye: over edges of 300 mm that is a third of a degree.
TAUGHT_BASE, TAUGHT_TOOL = (3.0, 0.5 * DEG), (3.0, 1 * DEG)  # [mm], [rad], 1 sigma


@dataclass(frozen=True)
class Controller:
    """Where the robot controller answers."""

    port: str = "sim"
    protocol: str = "line"
    baud: int = 115200
    axis_unit_deg: float = 1.0  # what one unit of a turning axis means to a GRBL


@dataclass(frozen=True, eq=False)
class Point:
    """A place that measurements name: a socket, the anchor of a ball bar."""

    position: Float[np.ndarray, " 3"] | None  # [mm], in the jig frame; None: to be fitted
    sigma: float = 0.0  # [mm], 1 sigma of each coordinate; 0: exact


@dataclass(frozen=True)
class Spacing:
    """The distance of two named points, from a certificate or a calliper."""

    start: str = field(metadata={"key": "from"})
    end: str = field(metadata={"key": "to"})
    distance: float = field(metadata={"key": "mm"})  # [mm]
    sigma: float = 0.02  # [mm]


@dataclass(frozen=True)
class Device:
    """What makes measurements of one kind: how long one takes, how exact it is, and where it can measure."""

    minutes: float = 0.25  # a measurement takes, getting there included
    sigma: float | None = None  # [mm], scatter; None: that of touches
    turn_sigma: float = field(default=0.02 * DEG, metadata={"key": "sigma_deg"})
    """[rad], scatter of a measured orientation about each axis."""
    range: tuple[float, float] = (200.0, 1000.0)  # [mm], shortest and longest distance
    max_tilt: float = 60 * DEG  # [rad], of a ball bar or a wire, and of the tool at a point, from the vertical
    box: Float[np.ndarray, "3 2"] | None = field(default=None, compare=False)  # [mm], what a tracker sees; None: usual
    stand: Float[np.ndarray, " 3"] | None = field(default=None, compare=False)
    """[mm], where a tracker stands in the frame in which it measures; None: its lines of sight are not looked at."""
    azimuth: tuple[float, float] = (-180 * DEG, 180 * DEG)
    """[rad], where a tracker looks to about z of that frame, from x."""
    elevation: tuple[float, float] = (-50 * DEG, 75 * DEG)
    """[rad], where a tracker looks to, above the x-y plane of that frame."""
    target_axis: Float[np.ndarray, " 3"] | None = field(default=None, compare=False)
    """Where the target looks to, in the tip frame; None: turned to the tracker by hand, or seen from all sides."""
    acceptance: float = 30 * DEG
    """[rad], between the axis of the target and the line of sight."""


TRACKER = Device(minutes=0.15, range=(500.0, 20_000.0))
DEVICES: dict[str, Device] = {
    "touch": Device(minutes=0.1),
    "position": TRACKER,
    "pose": TRACKER,
    "distance": Device(minutes=0.25),
    "contact": Device(minutes=1.0),
}
"""Devices by kind of measurement, as a cell has them that says nothing else: a touch is a search of some seconds, a
tracker waits until the robot stands still, the end of a ball bar is carried along, a socket is approached by hand."""


@dataclass(frozen=True, eq=False)
class Cell:
    """Everything that is known before the first touch."""

    robot: Robot
    """Its chain of joints, as on the drawing, with its errors and how its controller counts."""
    jig: Jig | None
    """None: what is measured has no faces."""
    base: Float[np.ndarray, " 6"] | None
    """[mm, rad], jig -> base; None: to be fitted."""
    tool: Float[np.ndarray, " 6"] | None
    """[mm, rad], flange -> tip; None: to be fitted."""
    wire: Wire = Wire()
    """The end that touches."""
    touch: TouchSettings = TouchSettings()
    """How touches are made, and their scatter."""
    zone: Zone | None = None
    """Where accuracy counts; None: the box around the jig."""
    priors: Priors = Priors()
    """Tolerances of base, tool, links and joint errors, 1 sigma."""
    controller: Controller = Controller()
    """Port and protocol."""
    fixed: frozenset[str] = frozenset()
    """Names of parameters that are not estimated."""
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """[mm] or [rad], by parameter name."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the files that describe the cell."""
    placements: Mapping[str, Float[np.ndarray, " 6"] | None] = field(default_factory=dict)
    """Further stands of jig or tracker [mm, rad], stand -> base as `base` is; None: to be fitted."""
    tools: Mapping[str, Float[np.ndarray, " 6"] | None] = field(default_factory=dict)
    """Further wires or targets [mm, rad], flange -> tip as `tool` is; None: to be fitted."""
    points: Mapping[str, Point] = field(default_factory=dict)
    """By name: sockets and anchors [mm], in the jig frame."""
    spacings: tuple[Spacing, ...] = ()
    """Known distances between points [mm]."""
    devices: Mapping[str, Device] = field(default_factory=dict)
    """By kind of measurement; DEVICES for the others."""
    serial: str = ""
    """Number of the robot."""
    obstacles: tuple[Shape, ...] = ()
    """Table, positioner, fence; their poses are in the jig frame."""

    @cached_property
    def theta(self) -> Float[np.ndarray, " parameters"]:
        """Nominal parameters; zeros stand for a base or a tool that is to be fitted."""
        zero = np.zeros(6)
        return self.robot.theta(zero if self.base is None else self.base, zero if self.tool is None else self.tool)

    @cached_property
    def prior(self) -> Float[np.ndarray, " parameters"]:
        """Prior standard deviations [mm] or [rad]; infinite for a base or a tool that is to be fitted."""
        prior = self.scale.copy()
        prior[:6] *= np.inf if self.base is None else 1.0
        prior[-6:] *= np.inf if self.tool is None else 1.0
        return prior

    @cached_property
    def scale(self) -> Float[np.ndarray, " parameters"]:
        """Sizes that make parameters of different units comparable [mm] or [rad]: the priors, always finite."""
        group = {"base": self.priors.base, "tool": self.priors.tool}
        names = zip(self.robot.parameters, self.robot.angular, strict=True)
        scale = np.array([group.get(name.split(".")[0], self.priors.link)[angular] for name, angular in names])
        scale[6 + 5 * len(self.robot.joints) : -6] = self._error_scale
        return scale

    @cached_property
    def spread(self) -> Float[np.ndarray, " parameters"]:
        """How far robots are from their drawing [mm] or [rad], 1 sigma: 0 for what is fixed, or not known at all."""
        fixed = [name in self.fixed for name in self.robot.parameters]
        return np.where(fixed | np.isinf(self.prior), 0.0, self.prior)

    @property
    def _error_scale(self) -> list[float]:
        """Sizes of the error parameters, in inside units."""
        if not self.robot.errors:
            return []
        from identify.model.joint_error_models import SIZES

        sizes = [(key, SIZES[key]) for _, key, _ in self.robot.error_parameters]
        return [self.priors.errors.get(key, size.usual) * size.inside for key, size in sizes]

    @property
    def neck(self) -> float:
        """How far behind the tip the torch bends from the wire's direction towards the flange [mm]; 0 for a pin."""
        if self.tool is None or (length := float(np.linalg.norm(self.tool[:3]))) < PIN:
            return 0.0
        return min(NECK, 0.5 * length)

    @cached_property
    def kinematics(self) -> Kinematics:
        """The compiled kinematics of the robot."""
        return shared_kinematics(self.robot)

    @property
    def the_jig(self) -> Jig:
        """The jig; raises InputError if the cell has none."""
        if self.jig is None:
            raise InputError("the cell has no jig; name one in cell.yaml (jig: library:step-block)")
        return self.jig

    def device(self, kind: str) -> Device:
        """What makes measurements of a kind, with the scatter that it has here."""
        device = self.devices.get(kind) or DEVICES.get(kind) or Device()
        return device if device.sigma is not None else replace(device, sigma=self.touch.sigma)

    def sigma(self, kind: str) -> float:
        """The scatter of measurements of a kind that state none [mm]."""
        return self.device(kind).sigma or self.touch.sigma

    @property
    def places(self) -> dict[str, Float[np.ndarray, " 3"]]:
        """Coordinates of the named points [mm]; 0 of those that are to be fitted."""
        return {name: np.zeros(3) if p.position is None else p.position for name, p in self.points.items()}

    def unknown_face(self, name: str) -> str:
        """The sentence for a face that the jig does not have."""
        if self.jig is None:
            return f"face '{name}' needs a jig; name one in cell.yaml (jig: library:step-block)"
        names = ", ".join(self.jig.by_name)
        return f"jig '{self.jig.name}' has no face '{name}'{nearest(name, self.jig.by_name)}; its faces: {names}"
