"""From the YAML files of a cell, a robot and a jig to what they describe."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files as package_files
from pathlib import Path
from typing import Literal

import numpy as np

from identify.model.cell import Cell
from identify.model.entries import cell_of, jig_of, robot_of
from identify.model.files import InputError, Mistake, digest, nearest
from identify.model.jig import Jig
from identify.model.robot import Robot
from identify.model.schema import CellFile, Document, JigFile, JointEntry, RobotFile, UrdfEntry, load

LIBRARY = "library:"


def library(kind: Literal["robots", "jigs", "cells"]) -> dict[str, Path]:
    """The files that travel with touchcal, by name."""
    folder = Path(str(package_files("identify.model") / "library" / kind))
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def read_cell(path: Path) -> Cell:
    """Read cell.yaml and the robot and jig that it names; raises InputError with every mistake of all of them."""
    file, document = load(path, CellFile)
    mistakes: list[Mistake] = []
    robot = jig = None
    sources = {path.name: digest(path)}
    with _collecting(mistakes):
        robot = _robot(file.robot, document, sources)
    with _collecting(mistakes):
        jig = None if file.jig is None else read_jig(_resolve(file.jig, "jigs", "jig", document, sources))
    mistakes += _cell_mistakes(file, document, robot)
    if mistakes or robot is None:
        raise InputError(mistakes)
    return cell_of(file, robot, jig, sources)


def read_robot(path: Path) -> Robot:
    """Read robot.yaml; raises InputError with every mistake."""
    file, document = load(path, RobotFile)
    wrong = [m for i, entry in enumerate(file.joints) for m in _joint_mistakes(i, entry, document)]
    names = [entry.name or f"j{i + 1}" for i, entry in enumerate(file.joints)]
    for i, name in enumerate(names):
        if name in names[:i] or name in {"base", "tool"} or "." in name:
            wrong.append(
                document.wrong(f"joint name '{name}' is taken or has a dot; choose another", "joints", i, "name")
            )
    for i, capsule in enumerate(file.capsules):
        if capsule.link > len(names):
            wrong.append(
                document.wrong(f"link {capsule.link} does not exist; the last is {len(names)}", "capsules", i, "link")
            )
    lengths = np.abs([value for entry in file.joints for value in (entry.a_mm, entry.d_mm)])
    if 0 < lengths.max() < 5:
        wrong.append(
            document.wrong(f"no link is longer than {lengths.max():g} mm: metres? write millimetres", "joints")
        )
    angles = np.abs([value for e in file.joints for value in (e.theta_deg, e.alpha_deg)])
    if np.isin(angles.round(3), np.round([np.pi, np.pi / 2], 3)).any():
        wrong.append(document.wrong("a link angle of 1.571 or 3.142: radians? write degrees", "joints"))
    if wrong:
        raise InputError(wrong)
    return robot_of(file)


def read_jig(path: Path) -> Jig:
    """Read jig.yaml; raises InputError with every mistake."""
    file, document = load(path, JigFile)
    jig = jig_of(file)
    wrong = []
    for i, face in enumerate(jig.faces):
        if face.name in {f.name for f in jig.faces[:i]}:
            wrong.append(
                document.wrong(f"face '{face.name}' is named twice; give it a name of its own", "faces", i, "name")
            )
        if np.linalg.norm(np.cross(face.u, face.v)) < 1e-6 * max(face.size.prod(), 1e-9):
            wrong.append(document.wrong(f"face '{face.name}': u and v span no area", "faces", i, "u_mm"))
        elif abs(face.u @ face.v) > 1e-6 * face.size.prod():
            wrong.append(document.wrong(f"face '{face.name}': u and v are not at right angles", "faces", i, "u_mm"))
    if 0 < max(face.size.max() for face in jig.faces) < 5:
        wrong.append(document.wrong("no face is larger than 5 mm: metres? write millimetres", "faces"))
    for i, box in enumerate(file.boxes):
        if not np.all(np.array(box.lower_mm) < np.array(box.upper_mm)):
            wrong.append(document.wrong("lower_mm is not below upper_mm", "boxes", i, "lower_mm"))
    if wrong:
        raise InputError(wrong)
    return jig


@contextmanager
def _collecting(mistakes: list[Mistake]) -> Iterator[None]:
    """Gather the mistakes of one file and go on to the next."""
    try:
        yield
    except InputError as error:
        mistakes += [m for m in error.mistakes if isinstance(m, Mistake)]


def _resolve(name: str, kind: Literal["robots", "jigs"], key: str, document: Document, sources: dict[str, str]) -> Path:
    """The file that a `library:` name or a path relative to the cell file stands for."""
    if name.startswith(LIBRARY):
        known = library(kind)
        short = name.removeprefix(LIBRARY)
        if short not in known:
            raise InputError(
                [
                    document.wrong(
                        f"the library has no {key} '{short}'{nearest(short, known)}; it has {', '.join(known)}", key
                    )
                ]
            )
        path = known[short]
    else:
        path = document.path.parent / name
        if not path.is_file():
            raise InputError([document.wrong(f"{key} file '{name}' does not exist beside {document.path.name}", key)])
    sources[path.name] = digest(path)
    return path


def _robot(source: str | UrdfEntry, document: Document, sources: dict[str, str]) -> Robot:
    if isinstance(source, str):
        return read_robot(_resolve(source, "robots", "robot", document, sources))
    from identify.model.urdf import read_urdf

    path = document.path.parent / source.urdf
    if not path.is_file():
        raise InputError(
            [document.wrong(f"URDF '{source.urdf}' does not exist beside {document.path.name}", "robot", "urdf")]
        )
    sources[path.name] = digest(path)
    return read_urdf(path, source.base, source.flange)


def _cell_mistakes(file: CellFile, document: Document, robot: Robot | None) -> list[Mistake]:
    """What single values cannot show: units, names of parameters, order of bounds."""
    wrong = []
    for key, entry in (("base", file.base), ("tool", file.tool)):
        if entry != "fit" and 0 < max(abs(entry.x_mm), abs(entry.y_mm), abs(entry.z_mm)) < 5:
            wrong.append(document.wrong(f"{key} lies within 5 mm of its origin: metres? write millimetres", key))
    if file.zone is not None:
        for axis, (lo, hi) in zip("xyz", file.zone.box_mm, strict=True):
            if lo >= hi:
                wrong.append(
                    document.wrong(
                        f"zone box: {axis} runs from {lo:g} to {hi:g}; write the smaller first", "zone", "box_mm"
                    )
                )
        if max(abs(v) for pair in file.zone.box_mm for v in pair) < 5:
            wrong.append(
                document.wrong(
                    "the zone lies within 5 mm of the jig's origin: metres? write millimetres", "zone", "box_mm"
                )
            )
    names = robot.parameters if robot else ()
    for i, name in enumerate(file.fixed):
        if robot and name not in names:
            wrong.append(
                document.wrong(f"fixed: the robot has no parameter '{name}'{nearest(name, names)}", "fixed", i)
            )
    for name, (lo, hi) in file.bounds.items():
        if robot and name not in names:
            wrong.append(
                document.wrong(f"bounds: the robot has no parameter '{name}'{nearest(name, names)}", "bounds", name)
            )
        if lo >= hi:
            wrong.append(
                document.wrong(f"bounds of {name} run from {lo:g} to {hi:g}; write the smaller first", "bounds", name)
            )
    return wrong


def _joint_mistakes(i: int, entry: JointEntry, document: Document) -> list[Mistake]:
    unit, other = ("mm", "deg") if entry.type == "prismatic" else ("deg", "mm")
    limits = getattr(entry, f"limits_{unit}")
    wrong = []
    if limits is None:
        wrong.append(document.wrong(f"joint {i + 1} needs limits_{unit}: [lower, upper]", "joints", i))
    elif limits[0] >= limits[1]:
        wrong.append(
            document.wrong(
                f"joint {i + 1}: limits run from {limits[0]:g} to {limits[1]:g}", "joints", i, f"limits_{unit}"
            )
        )
    elif unit == "deg" and max(map(abs, limits)) < 7:
        wrong.append(
            document.wrong(f"joint {i + 1}: limits within 7 degrees: radians? write degrees", "joints", i, "limits_deg")
        )
    misplaced = [key for key in (f"limits_{other}", f"speed_{other}_s") if getattr(entry, key) is not None]
    sentence = f"joint {i + 1} is {entry.type}: write {{}} in place of {{}}"
    return wrong + [
        document.wrong(sentence.format(key.replace(other, unit), key), "joints", i, key) for key in misplaced
    ]
