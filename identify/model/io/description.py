"""From the YAML files of a cell, a robot and a jig to what they describe."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from importlib.resources import files as package_files
from pathlib import Path
from typing import Literal

import numpy as np

from identify.model.cell import Cell
from identify.model.files import InputError, Mistake, digest, nearest
from identify.model.io.checks import cell_mistakes, error_mistakes, error_value_mistakes, jig_mistakes, robot_mistakes
from identify.model.io.document import Document, usable, validated
from identify.model.io.entries import cell_of, equipped, jig_of, robot_of
from identify.model.io.schema import CellFile, JigFile, RobotFile, UrdfEntry
from identify.model.jig import Jig
from identify.model.robot import Robot

LIBRARY = "library:"


def library(kind: Literal["robots", "jigs", "cells"]) -> dict[str, Path]:
    """The files that travel with touchcal, by name."""
    folder = Path(str(package_files("identify.model.io") / "library" / kind))
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def read_cell(path: Path | str) -> Cell:
    """Read cell.yaml and the robot and jig that it names; raises InputError with every mistake of all of them."""
    path = Path(path)
    document = Document(path)
    file, mistakes = validated(document, CellFile)
    sources = {path.name: digest(path)}
    robot = jig = None
    with _collecting(mistakes):
        robot = _robot(document, sources)
    with _collecting(mistakes):
        jig = _jig(document, sources)
    mistakes += error_mistakes(document)
    if robot is not None and file is not None and not mistakes:
        robot = equipped(file, robot)
    mistakes += cell_mistakes(document, robot)
    if mistakes or file is None or robot is None:
        raise InputError(mistakes)
    cell = cell_of(file, robot, jig, sources, path.parent)
    meshes = (*cell.obstacles, *(() if jig is None else jig.obstacles))
    sources |= {shape.file: digest(shape.path) for shape in meshes if shape.path is not None}
    return cell


def read_robot(path: Path | str) -> Robot:
    """Read robot.yaml; raises InputError with every mistake."""
    path = Path(path)
    document = Document(path)
    file, mistakes = validated(document, RobotFile)
    mistakes += robot_mistakes(document)
    if mistakes or file is None:
        raise InputError(mistakes)
    robot = robot_of(file)
    if mistakes := error_value_mistakes(document, robot):
        raise InputError(mistakes)
    return robot


def read_jig(path: Path | str) -> Jig:
    """Read jig.yaml; raises InputError with every mistake."""
    path = Path(path)
    document = Document(path)
    file, mistakes = validated(document, JigFile)
    mistakes += jig_mistakes(document)
    if mistakes or file is None:
        raise InputError(mistakes)
    return jig_of(file, path.parent)


def named_jig(name: str) -> Path:
    """The file of a jig or workpiece that a path or library:NAME stands for."""
    if not name.startswith(LIBRARY):
        return Path(name)
    names, short = library("jigs"), name.removeprefix(LIBRARY)
    if short not in names:
        raise InputError(f"the library has no jig '{short}'{nearest(short, names)}; it has {', '.join(names)}")
    return names[short]


@contextmanager
def _collecting(mistakes: list[Mistake]) -> Iterator[None]:
    """Gather the mistakes of one file and go on to the next."""
    try:
        yield
    except InputError as error:
        mistakes += [m for m in error.mistakes if isinstance(m, Mistake)]


def _robot(document: Document, sources: dict[str, str]) -> Robot | None:
    """The robot that a cell names, though the cell may have other mistakes."""
    source = document.get("robot")
    if isinstance(source, str):
        if source.lower().endswith((".urdf", ".xacro")):
            cure = f"robot: {{urdf: {source}, base: <link>, flange: <link>}}"
            raise InputError([document.wrong(f"a URDF needs the two links of its chain; write {cure}", "robot")])
        path = _resolve(source, "robots", "robot", document, sources)
        return _robot_of_library(path) if source.startswith(LIBRARY) else read_robot(path)
    if entry := usable(source, UrdfEntry):
        from identify.model.urdf.chain import read_urdf

        robot = read_urdf(_beside(entry.urdf, document, sources, "robot", "urdf"), entry.base, entry.flange)
        sources |= {shape.file: digest(shape.path) for shape in robot.shapes if shape.path is not None}
        return _narrowed(robot, entry, document)
    return None


def _narrowed(robot: Robot, entry: UrdfEntry, document: Document) -> Robot:
    """A robot whose joints keep the limits of the cell file as well as those of its URDF."""
    joints = {joint.name: joint for joint in robot.joints}
    for key, ranges, slides in (("limits_deg", entry.limits_deg, False), ("limits_mm", entry.limits_mm, True)):
        for name, (lower, upper) in ranges.items():
            joint = joints.get(name)
            if joint is None:
                text = f"the robot has no joint '{name}'{nearest(name, joints)}; it has {', '.join(joints)}"
                raise InputError([document.wrong(text, "robot", key, name)])
            if joint.prismatic != slides:
                text = f"joint '{name}' {'slides: limits_mm' if joint.prismatic else 'turns: limits_deg'}"
                raise InputError([document.wrong(text, "robot", key, name)])
            unit = 1.0 if slides else np.pi / 180
            low, high = max(lower * unit, joint.lower), min(upper * unit, joint.upper)
            if low >= high:
                text = f"joint '{name}' has nothing left between {lower:g} and {upper:g}; the URDF allows"
                allowed = f"{joint.lower / unit:g} to {joint.upper / unit:g}"
                raise InputError([document.wrong(f"{text} {allowed}", "robot", key, name)])
            joints[name] = replace(joint, lower=low, upper=high)
    return replace(robot, joints=tuple(joints.values()))


def _jig(document: Document, sources: dict[str, str]) -> Jig | None:
    """The jig that a cell names, though the cell may have other mistakes."""
    source = document.get("jig")
    if not isinstance(source, str):
        return None
    path = _resolve(source, "jigs", "jig", document, sources)
    return _jig_of_library(path) if source.startswith(LIBRARY) else read_jig(path)


_robot_of_library, _jig_of_library = lru_cache(read_robot), lru_cache(read_jig)  # files that do not change


def _resolve(name: str, kind: Literal["robots", "jigs"], key: str, document: Document, sources: dict[str, str]) -> Path:
    """The file that a `library:` name or a path relative to the cell file stands for."""
    if not name.startswith(LIBRARY):
        return _beside(name, document, sources, key)
    names, short = library(kind), name.removeprefix(LIBRARY)
    if short not in names:
        hint = f"{nearest(short, names)}; it has {', '.join(names)}"
        raise InputError([document.wrong(f"the library has no {key} '{short}'{hint}", key)])
    sources[f"{LIBRARY}{kind}/{short}"] = digest(names[short])
    return names[short]


def _beside(name: str, document: Document, sources: dict[str, str], *key: str) -> Path:
    """A file named relative to the cell file."""
    path = document.path.parent / name
    if not path.is_file():
        raise InputError([document.wrong(f"{key[-1]} file '{name}' does not exist beside {document.path.name}", *key)])
    sources[name] = digest(path)
    return path
