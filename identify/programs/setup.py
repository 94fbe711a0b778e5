"""What a program does not say itself: frames, tools, and how the maker counts the joints; a small YAML file.

    frames: {1: {x_mm: 800, y_mm: 0, z_mm: 400, rz_deg: 90}}   # in the robot's base, by number or name
    tools: {3: {z_mm: 410, ry_deg: -18}}                       # from the flange, as the controller has them
    joints: {sign: {j3: -1}, coupled: true}                    # in place of the cell's, as far as it says something
    near_deg: [0, 0, 0, 0, -90, 0]                             # a posture to look for solutions from
    posture: flags                                             # or nearest: to near_deg, whatever the flags say
    fixed_to: jig                                              # or robot: points that stand with the robot's base
    group: 1                                                   # the motion group of the robot in programs of several
    position_variables: false                                  # true: correct Yaskawa P variables too

A frame that is not named is the robot's base, a tool that is not named the cell's.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from identify.model.files import InputError, Mistake
from identify.model.frames import transform
from identify.model.io.document import Document, load
from identify.model.io.entries import pose_of
from identify.model.io.joint_counting import counting_mistakes, counting_of
from identify.model.io.schema import JointsEntry, Number, PoseEntry, Strict
from identify.model.joint_counting import AS_MODEL, JointCounting
from identify.model.robot import Robot
from identify.programs.backups import is_backup, read_backup


class TableJoints(JointsEntry):
    """`joints:` as in cell.yaml; `coupled: true` is joint 3 with joint 2, `coupled: false` none."""

    coupled: bool | dict[str, str] | None = None  # type: ignore[assignment]


class SetupFile(Strict):
    """The table of frames, tools and joints."""

    frames: dict[int | str, PoseEntry] = Field(default_factory=dict)
    tools: dict[int | str, PoseEntry] = Field(default_factory=dict)
    joints: TableJoints = TableJoints()
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
    joints: JointCounting = AS_MODEL  # in place of the cell's, as far as it says something
    coupled: bool | None = None  # joint 3 with joint 2; None: by `joints`, by the cell, or as the maker does
    near: Float[np.ndarray, " joints"] | None = None  # [rad] or [mm], the model's
    posture: Literal["flags", "nearest"] = "flags"
    fixed_to: Literal["jig", "robot"] = "jig"
    group: int = 1
    position_variables: bool = False


def read_setups(paths: Sequence[Path], robot: Robot) -> Setup:
    """One table from several files: backups of a controller and at most one YAML file, whose frames and tools win."""
    tables = [path for path in paths if not is_backup(path)]
    if len(tables) > 1:
        raise InputError(f"{tables[1]}: one YAML table is enough; the other files are backups of the controller")
    setup = read_setup(tables[0], robot) if tables else Setup()
    for path in (path for path in paths if is_backup(path)):
        frames, tools = read_backup(path)
        setup = replace(setup, frames={**frames, **setup.frames}, tools={**tools, **setup.tools})
    return setup


def read_setup(path: Path, robot: Robot) -> Setup:
    """Read the table of a robot's frames, tools and joints; raises InputError with every mistake."""
    file, document = load(path, SetupFile)
    names = [joint.name for joint in robot.joints]
    if wrong := _mistakes(file, document, names):
        raise InputError(wrong)
    coupled = file.joints.coupled if isinstance(file.joints.coupled, bool) else None
    return Setup(
        frames=_poses(file.frames),
        tools=_poses(file.tools),
        joints=counting_of(_plain(file.joints), names),
        coupled=coupled,
        near=None if file.near_deg is None else np.array(file.near_deg) * robot.joint_unit(),
        posture=file.posture,
        fixed_to=file.fixed_to,
        group=file.group,
        position_variables=file.position_variables,
    )


def _poses(entries: Mapping[int | str, PoseEntry]) -> dict[str, Float[np.ndarray, "4 4"]]:
    return {str(name): transform(np.asarray(pose_of(entry))) for name, entry in entries.items()}


def _plain(entry: TableJoints) -> JointsEntry:
    """The entry as a cell has it: a coupling that is only true or false is left out."""
    values = entry.model_dump()
    return JointsEntry(**values | {"coupled": None if isinstance(entry.coupled, bool) else entry.coupled})


def _mistakes(file: SetupFile, document: Document, names: Sequence[str]) -> list[Mistake]:
    wrong = counting_mistakes(document, names)
    if file.near_deg is not None and len(file.near_deg) != len(names):
        text = f"near_deg has {len(file.near_deg)} numbers, the robot has {len(names)} joints"
        wrong.append(document.wrong(text, "near_deg"))
    return wrong


def counting(robot: Robot, setup: Setup, coupled: bool) -> JointCounting:
    """How a maker counts the joints of a robot: by the table, else by the cell, else joint 3 as the maker does."""
    table, cell = setup.joints, robot.counting
    pair = ((2, 1, 1),) if len(robot.joints) > 2 else ()
    couplings: tuple[tuple[int, int, int], ...] = pair if setup.coupled else ()
    if setup.coupled is None:
        couplings = table.coupled or cell.coupled or (pair if coupled and not cell.differs else ())
    return JointCounting(
        sign=table.sign or cell.sign,
        zero=table.zero or cell.zero,
        coupled=couplings,
        pulses=table.pulses or cell.pulses,
    )
