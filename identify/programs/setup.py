"""What a program does not say itself: frames, tools, and how the maker counts the joints; a small YAML file.

    frames: {1: {x_mm: 800, y_mm: 0, z_mm: 400, rz_deg: 90}}   # in the robot's base, by number or name
    tools: {3: {z_mm: 410, ry_deg: -18}}                       # from the flange, as the controller has them
    joints: {sign: [1, 1, -1, 1, 1, 1], zero_deg: [0, 0, 0, 0, 0, 0], coupled: true, pulses_per_deg: [1000, ...]}
    near_deg: [0, 0, 0, 0, -90, 0]                             # a posture to look for solutions from
    posture: flags                                             # or nearest: to near_deg, whatever the flags say
    fixed_to: jig                                              # or robot: points that stand with the robot's base
    group: 1                                                   # the motion group of the robot in programs of several
    position_variables: false                                  # true: correct Yaskawa P variables too

A frame that is not named is the robot's base, a tool that is not named the cell's.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from identify.model.files import InputError, Mistake
from identify.model.frames import transform
from identify.model.io.document import Document, load
from identify.model.io.entries import pose_of
from identify.model.io.schema import Number, PoseEntry, Positive, Strict
from identify.model.robot import Robot


class JointsEntry(Strict):
    """How the maker's joints become the model's: model = sign * (maker - zero), joint 3 with joint 2 where coupled."""

    sign: list[Literal[1, -1]] | None = None
    zero_deg: list[Number] | None = None
    coupled: bool | None = None
    pulses_per_deg: list[Positive] | None = None


class SetupFile(Strict):
    """The table of frames, tools and joints."""

    frames: dict[int | str, PoseEntry] = Field(default_factory=dict)
    tools: dict[int | str, PoseEntry] = Field(default_factory=dict)
    joints: JointsEntry = JointsEntry()
    near_deg: list[Number] | None = None
    posture: Literal["flags", "nearest"] = "flags"
    fixed_to: Literal["jig", "robot"] = "jig"
    group: int = 1
    position_variables: bool = False


@dataclass(frozen=True, eq=False)
class Setup:
    """Frames and tools by name [mm], and the maker's way to count joints; the defaults of a program without a table."""

    frames: Mapping[str, Float[np.ndarray, "4 4"]] = field(default_factory=dict)
    tools: Mapping[str, Float[np.ndarray, "4 4"]] = field(default_factory=dict)
    sign: Float[np.ndarray, " joints"] | None = None
    zero: Float[np.ndarray, " joints"] | None = None  # [deg]
    coupled: bool | None = None  # None: as the maker does
    pulses: Float[np.ndarray, " joints"] | None = None  # a degree
    near: Float[np.ndarray, " joints"] | None = None  # [rad] or [mm], the model's
    posture: Literal["flags", "nearest"] = "flags"
    fixed_to: Literal["jig", "robot"] = "jig"
    group: int = 1
    position_variables: bool = False


def read_setup(path: Path, robot: Robot) -> Setup:
    """Read the table of a robot's frames, tools and joints; raises InputError with every mistake."""
    file, document = load(path, SetupFile)
    wrong = _lengths(file, document, len(robot.joints))
    if wrong:
        raise InputError(wrong)
    joints = file.joints
    return Setup(
        frames=_poses(file.frames), tools=_poses(file.tools), sign=_array(joints.sign), zero=_array(joints.zero_deg),
        coupled=joints.coupled, pulses=_array(joints.pulses_per_deg),
        near=None if file.near_deg is None else np.array(file.near_deg) * robot.joint_unit(),
        posture=file.posture, fixed_to=file.fixed_to, group=file.group, position_variables=file.position_variables,
    )  # fmt: skip


def _poses(entries: Mapping[int | str, PoseEntry]) -> dict[str, Float[np.ndarray, "4 4"]]:
    return {str(name): transform(np.asarray(pose_of(entry))) for name, entry in entries.items()}


def _array(values: list[float] | list[Literal[1, -1]] | None) -> Float[np.ndarray, " joints"] | None:
    return None if values is None else np.array(values, dtype=float)


def _lengths(file: SetupFile, document: Document, joints: int) -> list[Mistake]:
    lists = [(("joints", name), getattr(file.joints, name)) for name in ("sign", "zero_deg", "pulses_per_deg")]
    return [
        document.wrong(f"{'.'.join(place)} has {len(values)} numbers, the robot has {joints} joints", *place)
        for place, values in [*lists, (("near_deg",), file.near_deg)]
        if values is not None and len(values) != joints
    ]


@dataclass(frozen=True, eq=False)
class JointMap:
    """From joints as the maker counts them [deg] to the model's [rad], and back."""

    robot: Robot
    setup: Setup
    coupled: bool

    def model(self, maker: Float[np.ndarray, "rows joints"]) -> Float[np.ndarray, "rows joints"]:
        """Joints of the model [rad] or [mm]."""
        q = maker.copy()
        if self.coupled:
            q[:, 2] += q[:, 1]
        return self._sign * (q - self._zero) * self.robot.joint_unit()

    def maker(self, model: Float[np.ndarray, "rows joints"]) -> Float[np.ndarray, "rows joints"]:
        """Joints as the maker counts them [deg] or [mm]."""
        q = self._sign * model / self.robot.joint_unit() + self._zero
        if self.coupled:
            q[:, 2] -= q[:, 1]
        return q

    @property
    def _sign(self) -> Float[np.ndarray, " joints"]:
        return np.ones(len(self.robot.joints)) if self.setup.sign is None else self.setup.sign

    @property
    def _zero(self) -> Float[np.ndarray, " joints"]:
        return np.zeros(len(self.robot.joints)) if self.setup.zero is None else self.setup.zero


def joint_map(robot: Robot, setup: Setup, coupled: bool) -> JointMap:
    """How a maker counts the joints of a robot; `coupled` is what the maker does if the table does not say."""
    both = coupled if setup.coupled is None else setup.coupled
    return JointMap(robot, setup, both and len(robot.joints) > 2)
