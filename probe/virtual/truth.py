"""The hidden truth of a virtual cell: what the robot, the jig and the wire really are.

A truth file is a small YAML file. Parameters stand by name in file units (mm or deg); those not named are nominal:

    name: arc-welder
    source: where the numbers come from
    errors: [harmonics, compliance]  # joint error models of the true robot; the cell's where not given
    parameters: {base.x: 339.106, j2.theta: -91.337, j2.cos1: 0.02}
    faces_mm: {top-low: 0.02}        # by how much a face stands proud of its drawing
    effects:
      sigma_mm: 0.05                 # scatter of a touch along the normal; the cell's touch.sigma_mm where not given
      joint_noise_deg: 0.001         # 1 sigma, drawn anew for every motion; joint_noise_mm where a joint slides
      backlash_deg: 0.005            # full play; backlash_mm where a joint slides
      relay_delay_ms: 4              # the latch comes that much after the contact
      servo_ms: 1                    # the latch and the stop happen at the next servo step
      bounce_ms: 3                   # the contact chatters that long after it closes and after it opens
      wire: [{touch: 40, change_mm: -1.5}]   # after that many contacts the wire is longer (+) or shorter (-)
      warming: [{touch: 0, temperature_c: 20}, {touch: 100, temperature_c: 32}]   # in straight lines between
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import files as package_files
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float, Int
from pydantic import Field

from identify.model.cell import DEG, Cell
from identify.model.files import InputError, Mistake, nearest
from identify.model.frames import rotation
from identify.model.io.checks import error_mistakes
from identify.model.io.document import Document, load
from identify.model.io.schema import Strict
from identify.model.kinematics import Kinematics
from identify.model.robot import Robot

LIBRARY = "library:"
NotNegative = Annotated[float, Field(ge=0)]


@dataclass(frozen=True)
class Effects:
    """What makes two touches of the same place differ, and a latch late."""

    sigma: float | None = None  # [mm], scatter along the normal; None: the cell's
    joint_noise: tuple[float, float] = (0.0, 0.0)  # [mm] of sliding joints, [rad] of turning ones, 1 sigma a motion
    backlash: tuple[float, float] = (0.0, 0.0)  # [mm], [rad], full play
    relay_delay: float = 0.0  # [s]
    servo: float = 0.001  # [s]
    bounce: float = 0.0  # [s]
    wire: tuple[tuple[int, float], ...] = ()  # after so many contacts, a change of the stick-out [mm]
    warming: tuple[tuple[int, float], ...] = ()  # after so many contacts, the temperature [degC]


@dataclass(frozen=True, eq=False)
class Truth:
    """The true parameters of a cell and its effects; known to the virtual robot, and to the judge of a calibration."""

    theta: Float[np.ndarray, " parameters"]
    """[mm] or [rad]."""
    effects: Effects = Effects()
    """What sensor, controller, robot and jig do besides."""
    faces: Mapping[str, float] = field(default_factory=dict)
    """[mm], by how much a face stands proud of its drawing."""
    name: str = ""
    """Of the truth file."""
    robot: Robot | None = None
    """Where its error models are not the cell's."""

    def kinematics(self, cell: Cell) -> Kinematics:
        """The kinematics of the true robot."""
        same = self.robot is None or self.robot is cell.robot
        return cell.kinematics if same else _kinematics(self.robot)

    def temperature(self, contacts: Int[np.ndarray, " touches"]) -> Float[np.ndarray, " touches"]:
        """The temperature after numbers of contacts [degC]; NaN where the truth does not tell."""
        if not self.effects.warming:
            return np.full(len(contacts), np.nan)
        touch, temperature = np.array(self.effects.warming).T
        return np.asarray(np.interp(contacts, touch, temperature))

    def after(self, contacts: int) -> Float[np.ndarray, " parameters"]:
        """The parameters after a number of contacts.

        The tip has moved along the wire when its stick-out changed, and links have grown with the temperature.
        """
        change = sum(length for touch, length in self.effects.wire if contacts >= touch)
        theta = self.theta.copy()
        theta[-6:-3] += change * rotation(*theta[-3:])[:, 2]
        if self.robot is not None and self.effects.warming:
            warmth = float(self.temperature(np.array([contacts]))[0]) - self.robot.temperature
            links = self.robot.link_values(theta)  # a view
            names = self.robot.parameters
            for link, joint in zip(links, self.robot.joints, strict=True):
                grows = f"{joint.name}.growth"
                link[1:3] *= 1 + warmth * (theta[names.index(grows)] if grows in names else 0.0)
        return theta


@lru_cache(maxsize=8)
def _kinematics(robot: Robot) -> Kinematics:
    return Kinematics(robot)


class WireChange(Strict):
    """A cut, a feed or a bent wire."""

    touch: Annotated[int, Field(ge=0)]
    change_mm: float


class Warming(Strict):
    """A temperature at some time."""

    touch: Annotated[int, Field(ge=0)]
    temperature_c: float


class EffectsEntry(Strict):
    """The effects of a truth file."""

    sigma_mm: NotNegative | None = None
    joint_noise_deg: NotNegative = 0.0
    joint_noise_mm: NotNegative = 0.0
    backlash_deg: NotNegative = 0.0
    backlash_mm: NotNegative = 0.0
    relay_delay_ms: NotNegative = 0.0
    servo_ms: Annotated[float, Field(gt=0)] = 1.0
    bounce_ms: NotNegative = 0.0
    wire: tuple[WireChange, ...] = ()
    warming: tuple[Warming, ...] = ()


class TruthFile(Strict):
    """A truth file."""

    name: str = ""
    source: str = ""
    errors: list[str] | None = None
    parameters: dict[str, float] = Field(default_factory=dict)
    faces_mm: dict[str, float] = Field(default_factory=dict)
    effects: EffectsEntry = EffectsEntry()


def truths() -> dict[str, Path]:
    """The truths that travel with touchcal, by name."""
    folder = Path(str(package_files("identify.model.io") / "library" / "truths"))
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def truth_path(name: str) -> Path:
    """The file that `library:NAME` or a path stands for; raises InputError where the library has none such."""
    if not name.startswith(LIBRARY):
        return Path(name)
    short, names = name.removeprefix(LIBRARY), truths()
    if short not in names:
        raise InputError(f"the library has no truth '{short}'{nearest(short, names)}; it has {', '.join(names)}")
    return names[short]


def read_truth(path: Path, cell: Cell) -> Truth:
    """Read a truth file for a cell; raises InputError with every mistake."""
    file, document = load(path, TruthFile)
    if wrong := error_mistakes(document):
        raise InputError(wrong)
    if file.errors is not None:
        cell = replace(cell, robot=cell.robot.with_errors(tuple(file.errors)))
    if wrong := _unknown(file, document, cell):
        raise InputError(wrong)
    names, unit = cell.robot.parameters, cell.robot.parameter_unit()
    theta = cell.theta.copy()
    for name, value in file.parameters.items():
        theta[names.index(name)] = value * unit[names.index(name)]
    return Truth(theta, _effects(file.effects), dict(file.faces_mm), file.name or path.stem, cell.robot)


def draw_truth(cell: Cell, rng: np.random.Generator, *, scale: float = 1.0, jig: bool = False) -> Truth:
    """A robot drawn from the cell's priors times `scale`; with `jig`, faces off their drawing by their tolerances.

    Parameters that the cell calls fixed, or does not know at all (base or tool to be fitted), keep the cell's value;
    bounds hold.
    """
    names = cell.robot.parameters
    theta = cell.theta + scale * cell.spread * rng.standard_normal(len(names))
    lower, upper = np.array([cell.bounds.get(name, (-np.inf, np.inf)) for name in names]).T
    faces = {} if cell.jig is None or not jig else {f.name: f.tolerance * rng.standard_normal() for f in cell.jig.faces}
    return Truth(np.clip(theta, lower, upper), faces=faces, name="drawn", robot=cell.robot)


def _effects(entry: EffectsEntry) -> Effects:
    ms = 0.001
    return Effects(
        sigma=entry.sigma_mm,
        joint_noise=(entry.joint_noise_mm, entry.joint_noise_deg * DEG),
        backlash=(entry.backlash_mm, entry.backlash_deg * DEG),
        relay_delay=entry.relay_delay_ms * ms,
        servo=entry.servo_ms * ms,
        bounce=entry.bounce_ms * ms,
        wire=tuple((change.touch, change.change_mm) for change in entry.wire),
        warming=tuple((at.touch, at.temperature_c) for at in sorted(entry.warming, key=lambda at: at.touch)),
    )


def _unknown(file: TruthFile, document: Document, cell: Cell) -> list[Mistake]:
    """Parameters and faces that the cell does not have."""
    names, faces = cell.robot.parameters, () if cell.jig is None else tuple(cell.jig.by_name)
    wrong = [
        document.wrong(f"robot '{cell.robot.name}' has no parameter '{n}'{nearest(n, names)}", "parameters", n)
        for n in file.parameters
        if n not in names
    ]
    return wrong + [document.wrong(cell.unknown_face(n), "faces_mm", n) for n in file.faces_mm if n not in faces]
