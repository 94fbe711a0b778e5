"""Frames and tools in what controllers back up: FANUC sysframe.va, KUKA $config.dat, ABB SYS.MOD, Yaskawa .CND files.

Forms were compared with public texts; none is of ours. TOOL.CND: the backup of an SDA20D. UFRAME.CND: the text that a
public reader of such files keeps in its tests. SYS.MOD, user.sys: a system module of a public station, whose work
object is a comment, and declarations of work objects and tools in several public RAPID modules. $config.dat: lines that
two public readers quote. sysframe.va: a backup that a public reader quotes. A frame of zeros is one that nobody has
set: it is left out, so that a program which uses it is told so.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.model.cell import DEG
from identify.model.files import InputError, Mistake, read_bytes
from identify.model.frames import transform
from identify.programs.numbers import NUMBER
from identify.programs.orientation import from_quaternion

Frames = tuple[str, str, Float[np.ndarray, "4 4"]]  # frames or tools, the name, and the frame [mm]
VALUE = rf"\s*:?\s*({NUMBER})"
FANUC_BLOCK = re.compile(r"\$MNU(FRAME|TOOL)\s+Storage:(.*?)(?=\[\*SYSTEM\*\]|\Z)", re.DOTALL)
FANUC_FRAME = re.compile(
    rf"\[1\s*,\s*(\d+)\]\s*=[^\[]*?\bX{VALUE}\s*Y{VALUE}\s*Z{VALUE}\s*W{VALUE}\s*P{VALUE}\s*R{VALUE}", re.DOTALL
)
KUKA = re.compile(
    rf"\$?(BASE|TOOL)_DATA\[\s*(\d+)\s*\]\s*=\s*\{{(?:FRAME\s*:)?\s*X\s*({NUMBER})\s*,\s*Y\s*({NUMBER})\s*,\s*Z\s*({NUMBER})"
    rf"\s*,\s*A\s*({NUMBER})\s*,\s*B\s*({NUMBER})\s*,\s*C\s*({NUMBER})",
    re.IGNORECASE,
)
TRIPLE = rf"\[\s*({NUMBER})\s*,\s*({NUMBER})\s*,\s*({NUMBER})\s*\]"
QUADRUPLE = rf"\[\s*({NUMBER})\s*,\s*({NUMBER})\s*,\s*({NUMBER})\s*,\s*({NUMBER})\s*\]"
ABB_POSE = rf"\[\s*{TRIPLE}\s*,\s*{QUADRUPLE}\s*\]"
ABB_TOOL = re.compile(rf"\btooldata\s+(\w+)\s*:=\s*\[\s*TRUE\s*,\s*{ABB_POSE}", re.IGNORECASE)
ABB_FRAME = re.compile(
    rf"\bwobjdata\s+(\w+)\s*:=\s*\[\s*FALSE\s*,\s*TRUE\s*,\s*\"\"\s*,\s*{ABB_POSE}\s*,\s*{ABB_POSE}", re.IGNORECASE
)
ABB_COMMENT = re.compile(r'("[^"\n]*")|![^\n]*')  # a text keeps its exclamation mark
SIX = rf"({NUMBER})" + rf"\s*,\s*({NUMBER})" * 5
YASKAWA_TOOL = re.compile(rf"^//TOOL\s+(\d+)\s*$(?:(?!^//TOOL)[^\n]*\n)*?^\s*{SIX}\s*$", re.MULTILINE)
YASKAWA_FRAME = re.compile(rf"^//UFRAME\s+(\d+)\s*$(?:(?!^//UFRAME)[^\n]*\n)*?^/*BUSER\s*=?\s*{SIX}", re.MULTILINE)


def is_backup(path: Path) -> bool:
    """Whether a file is one of a controller, by its ending."""
    return path.suffix.lower() in READERS


def read_backup(path: Path) -> tuple[Mapping[str, Float[np.ndarray, "4 4"]], Mapping[str, Float[np.ndarray, "4 4"]]]:
    """Frames and tools [mm] by name, or number as text; raises InputError where the file holds none."""
    text = read_bytes(path).decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    frames = list(READERS[path.suffix.lower()](text))
    if not frames:
        what = "holds no frame and no tool that is set; is it the file with the frames of the robot?"
        raise InputError([Mistake(str(path), 0, what)])
    tables: dict[str, dict[str, Float[np.ndarray, "4 4"]]] = {"frame": {}, "tool": {}}
    for kind, name, T in frames:
        tables[kind][name] = T
    return tables["frame"], tables["tool"]


def _fanuc(text: str) -> Iterator[Frames]:
    for block in FANUC_BLOCK.finditer(text):
        for match in FANUC_FRAME.finditer(block[2]):
            x, y, z, w, p, r = map(float, match.groups()[1:])
            yield from _set("frame" if block[1] == "FRAME" else "tool", match[1], [x, y, z, r, p, w])


def _kuka(text: str) -> Iterator[Frames]:
    for match in KUKA.finditer(text):
        yield from _set(
            "frame" if match[1].upper() == "BASE" else "tool", match[2], [float(v) for v in match.groups()[2:]]
        )


def _yaskawa(text: str) -> Iterator[Frames]:
    for kind, pattern in (("frame", YASKAWA_FRAME), ("tool", YASKAWA_TOOL)):
        for match in pattern.finditer(text):
            x, y, z, rx, ry, rz = map(float, match.groups()[1:])
            yield from _set(kind, match[1], [x, y, z, rz, ry, rx])


def _abb(text: str) -> Iterator[Frames]:
    text = ABB_COMMENT.sub(lambda match: match[1] or "", text)
    for match in ABB_TOOL.finditer(text):
        yield "tool", match[1], _quaternion_pose([float(v) for v in match.groups()[1:]])
    for match in ABB_FRAME.finditer(text):
        numbers = [float(v) for v in match.groups()[1:]]
        yield "frame", match[1], _quaternion_pose(numbers[:7]) @ _quaternion_pose(numbers[7:])


def _set(kind: str, name: str, numbers: list[float]) -> Iterator[Frames]:
    """A frame of x, y, z, rz, ry, rx [mm, deg], if anybody has set it."""
    if any(numbers):
        yield kind, name, transform(np.array(numbers) * [1, 1, 1, DEG, DEG, DEG])


def _quaternion_pose(numbers: list[float]) -> Float[np.ndarray, "4 4"]:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = from_quaternion(np.array(numbers[3:])), numbers[:3]
    return T


READERS: Mapping[str, Callable[[str], Iterator[Frames]]] = {
    ".va": _fanuc,
    ".dat": _kuka,
    ".mod": _abb,
    ".sys": _abb,
    ".cnd": _yaskawa,
}
