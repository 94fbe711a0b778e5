"""What a serial robot is: joints, their five link parameters each, and the names of all parameters."""

import pickle
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError
from identify.model.joint import LINK_NAMES, Capsule, Joint
from identify.model.joint_counting import AS_MODEL, JointCounting
from identify.model.shape import Shape

POSE_NAMES = ("x", "y", "z", "rz", "ry", "rx")
FAR = 3.0  # times the widest joint limit, beyond which an angle was not meant in radians


@dataclass(frozen=True, eq=False)
class Robot:
    """A serial robot of any number of joints, between a base and a flange.

    Robots that are described alike are equal: functions that are compiled for one serve the others.
    """

    name: str
    joints: tuple[Joint, ...]
    source: str = ""
    capsules: tuple[Capsule, ...] = ()
    base_T_first: Float[np.ndarray, "4 4"] = field(
        default_factory=lambda: np.eye(4)
    )  # a URDF's base link, before joint 1
    last_T_flange: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))  # behind the last joint's frame
    errors: tuple[str, ...] = ()  # rows of ERROR_MODELS that this robot has
    error_values: tuple[float, ...] = ()  # inside units; empty: all zero, which is a robot without errors
    drawing: tuple[tuple[float, ...], ...] = ()  # five a joint [rad] or [mm]: where weights hang, if not by `joints`
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)  # against gravity, in the base frame
    payload: tuple[float, tuple[float, float, float]] | None = None  # [kg] and its centre [mm] in the flange frame
    temperature: float = 20.0  # [degC] for which the dimensions are
    shapes: tuple[Shape, ...] = ()  # of a URDF, for clearance
    counting: JointCounting = AS_MODEL  # how its controller counts the joints

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Robot) and self._description == other._description)

    def __hash__(self) -> int:
        return hash(self._description)

    @cached_property
    def _description(self) -> bytes:
        """All fields to the last digit."""
        return pickle.dumps([getattr(self, f.name) for f in fields(self)])

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters in the order base, five a joint, error models, tool."""
        return (
            *(f"base.{name}" for name in POSE_NAMES),
            *(f"{joint.name}.{name}" for joint in self.joints for name in LINK_NAMES),
            *(name for name, _, _ in self.error_parameters),
            *(f"tool.{name}" for name in POSE_NAMES),
        )

    @cached_property
    def error_parameters(self) -> tuple[tuple[str, str, str], ...]:
        """Name, key of its size, and model of every error parameter."""
        if not self.errors:
            return ()
        from identify.model.joint_error_models import SIZES, parameters  # CasADi, which others need not load

        for name, size, _ in parameters(self):
            if size not in SIZES:
                raise ValueError(f"joint error '{name}': size '{size}', expected one of {', '.join(SIZES)}")
        return parameters(self)

    @property
    def weighed(self) -> bool:
        """Whether the masses of the links are known."""
        return any(joint.mass > 0 for joint in self.joints)

    @cached_property
    def angular(self) -> tuple[bool, ...]:
        """Whether each parameter is an angle."""
        return tuple(unit == "deg" for unit in self.units)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """The unit of each parameter in files and on screens."""
        return tuple(unit for unit, _ in self._units)

    @cached_property
    def decimals(self) -> tuple[int, ...]:
        """Digits behind the point that a person wants to see of each parameter."""
        return tuple(6 if unit == "1" else 3 for unit in self.units)

    @cached_property
    def _units(self) -> tuple[tuple[str, float], ...]:
        """File unit of each parameter, and the factor from there to the inside."""
        angles, lengths = ("deg", np.pi / 180), ("mm", 1.0)
        pose = (lengths,) * 3 + (angles,) * 3
        link = (angles, lengths, lengths, angles, angles)
        return (*pose, *(link * len(self.joints)), *self._error_units, *pose)

    @cached_property
    def _error_units(self) -> tuple[tuple[str, float], ...]:
        if not self.errors:
            return ()
        from identify.model.joint_error_models import SIZES

        return tuple((SIZES[size].unit, SIZES[size].inside) for _, size, _ in self.error_parameters)

    @cached_property
    def prismatic(self) -> tuple[bool, ...]:
        """Whether each joint is prismatic."""
        return tuple(joint.prismatic for joint in self.joints)

    @property
    def kinds(self) -> str:
        """R for each joint that turns, P for each that slides, from the base on."""
        return "".join("P" if slides else "R" for slides in self.prismatic)

    @cached_property
    def lower(self) -> Float[np.ndarray, " joints"]:
        """Lower joint limits [rad] or [mm]."""
        return np.array([joint.lower for joint in self.joints])

    @cached_property
    def upper(self) -> Float[np.ndarray, " joints"]:
        """Upper joint limits [rad] or [mm]."""
        return np.array([joint.upper for joint in self.joints])

    @cached_property
    def speed(self) -> Float[np.ndarray, " joints"]:
        """Highest joint speeds [rad/s] or [mm/s]."""
        return np.array([joint.speed for joint in self.joints])

    @cached_property
    def links(self) -> Float[np.ndarray, " links"]:
        """Nominal link parameters of all joints, five each [rad] or [mm]."""
        return np.array([value for joint in self.joints for value in joint.link])

    @property
    def drawn(self) -> tuple[tuple[float, ...], ...]:
        """Link parameters by the drawing, which error models take for the dimensions of the arm."""
        return self.drawing or tuple(joint.link for joint in self.joints)

    def identified(self, theta: Float[np.ndarray, " parameters"]) -> "Robot":
        """The robot whose nominal links and errors are these parameters; weights hang where they did."""
        links = self.link_values(theta).tolist()
        joints = tuple(
            replace(joint, **dict(zip(LINK_NAMES, link, strict=True)))
            for joint, link in zip(self.joints, links, strict=True)
        )
        drawing, errors = self.drawn if self.errors else (), tuple(self.error_amounts(theta).tolist())
        return replace(self, joints=joints, drawing=drawing, error_values=errors)

    def with_errors(self, names: tuple[str, ...]) -> "Robot":
        """The robot with these models of joint errors, all zero, in place of its own."""
        return replace(self, errors=names, error_values=())

    def theta(self, base: Float[np.ndarray, " 6"], tool: Float[np.ndarray, " 6"]) -> Float[np.ndarray, " parameters"]:
        """The parameter vector of this robot standing at `base` and carrying `tool` [mm, rad]."""
        errors = np.array(self.error_values) if self.error_values else np.zeros(len(self.error_parameters))
        return np.concatenate([base, self.links, errors, tool])

    def link_values(self, theta: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, "joints 5"]:
        """The link parameters among all, one row a joint [rad] or [mm]."""
        return theta[6 : 6 + 5 * len(self.joints)].reshape(-1, 5)

    def error_amounts(self, theta: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, " errors"]:
        """The error parameters among all, in inside units."""
        return theta[6 + 5 * len(self.joints) : -6]

    def joint_unit(self) -> Float[np.ndarray, " joints"]:
        """Factors from file units (deg or mm) to the inside (rad or mm), one a joint."""
        return np.where(self.prismatic, 1.0, np.pi / 180)

    def from_controller(self, counts: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows joints"]:
        """Joints of the model [rad] or [mm] from the numbers that the controller shows [deg] or [mm]."""
        return (self.counting.from_controller(counts) if self.counting.differs else counts) * self.joint_unit()

    def to_controller(self, q: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows joints"]:
        """The numbers that the controller shows [deg] or [mm] for joints of the model [rad] or [mm]."""
        joints = q / self.joint_unit()
        return self.counting.to_controller(joints) if self.counting.differs else joints

    def require_radians(self, q: Float[np.ndarray, "*rows joints"]) -> None:
        """Raise InputError for joints of the model that are far beyond every limit, as degrees would be."""
        if q.shape[-1] != len(self.joints):
            return  # of another robot, which is said elsewhere
        turning = ~np.array(self.prismatic)
        limits = np.abs(np.concatenate([self.lower[turning], self.upper[turning]]))
        largest = np.nanmax(np.abs(q[..., turning]), initial=0.0)
        if largest > FAR * max(float(limits.max(initial=0.0)), np.pi):
            raise InputError(f"a joint angle is {largest:.4g} rad: degrees? functions take radians, np.radians(q)")

    def from_pulses(self, pulses: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows joints"]:
        """Joints of the model [rad] or [mm] from the controller's pulses; raises InputError if those are not known."""
        return self.from_controller(pulses / self.counting.per_degree)

    def to_pulses(self, q: Float[np.ndarray, "*rows joints"]) -> Float[np.ndarray, "*rows joints"]:
        """The controller's pulses, unrounded, for joints of the model; raises InputError if those are not known."""
        return self.to_controller(q) * self.counting.per_degree

    def parameter_unit(self) -> Float[np.ndarray, " parameters"]:
        """Factors from file units (deg, mm, ...) to the inside (rad, mm, ...), one a parameter."""
        return np.array([factor for _, factor in self._units])
