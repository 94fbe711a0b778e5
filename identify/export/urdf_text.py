"""The text of a URDF with the places of its joints, so that origins can be changed and nothing else."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

import numpy as np
from jaxtyping import Float

from identify.model.frames import pose, transform
from identify.model.urdf.document import METRE

TAG = re.compile(rb"""<[^>"']*(?:"[^"]*"[^>"']*|'[^']*'[^>"']*)*>""")
CHANGED = 1e-12  # [mm] or [rad], below which an origin keeps its text


@dataclass(eq=False)
class Joint:
    """A joint element: what it joins, and where its tags begin in the bytes of the file."""

    name: str
    kind: str
    start: int
    parent: str = ""
    child: str = ""
    axis: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    origin: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))  # [mm]
    origin_start: int | None = None

    @property
    def moves(self) -> bool:
        """Whether it is not fixed."""
        return self.kind != "fixed"


class UrdfText:
    """A URDF that `read_urdf` has found to be in order."""

    def __init__(self, text: str) -> None:
        self.content = text.encode()
        self.joints: list[Joint] = []
        self._depth: list[str] = []
        parser = expat.ParserCreate()
        parser.StartElementHandler = lambda tag, attributes: self._start(tag, attributes, parser.CurrentByteIndex)
        parser.EndElementHandler = lambda tag: self._depth.pop()
        parser.Parse(self.content, True)

    def _start(self, tag: str, attributes: dict[str, str], at: int) -> None:
        if tag == "joint" and len(self._depth) == 1:
            self.joints.append(Joint(attributes.get("name", ""), attributes.get("type", ""), at))
        elif self._depth[1:] == ["joint"]:
            joint = self.joints[-1]
            if tag in {"parent", "child"}:
                setattr(joint, tag, attributes.get("link", ""))
            elif tag == "axis" and "xyz" in attributes:
                axis = _numbers(attributes["xyz"])
                joint.axis = axis / np.linalg.norm(axis)
            elif tag == "origin":
                xyz, rpy = _numbers(attributes.get("xyz", "0 0 0")), _numbers(attributes.get("rpy", "0 0 0"))
                joint.origin, joint.origin_start = transform(np.concatenate([xyz * METRE, rpy[::-1]])), at
        self._depth.append(tag)

    def path(self, base: str, flange: str) -> tuple[list[Joint], list[Joint]]:
        """Joints to climb from the base, and joints to descend to the flange."""
        up, down = self._climb(base), self._climb(flange)
        while up and down and up[-1] is down[-1]:
            up, down = up[:-1], down[:-1]
        return up, down[::-1]

    def _climb(self, link: str) -> list[Joint]:
        above, joints = {joint.child: joint for joint in self.joints}, list[Joint]()
        while link in above:
            joints.append(above[link])
            link = above[link].parent
        return joints

    def changed(self, origins: Mapping[Joint, Float[np.ndarray, "4 4"]]) -> str:
        """The text with other origins; an origin that says the same already keeps its text."""
        content = self.content
        for joint, T in sorted(origins.items(), key=lambda item: -item[0].start):
            if np.abs(T - joint.origin).max() > CHANGED:
                content = _changed(content, joint, T)
        return content.decode()


def _numbers(text: str) -> Float[np.ndarray, " 3"]:
    return np.array([float(word) for word in text.split()])


def _changed(content: bytes, joint: Joint, T: Float[np.ndarray, "4 4"]) -> bytes:
    """The content with the origin of one joint replaced, or put in where there is none."""
    x, y, z, rz, ry, rx = (float(v) for v in pose(T))
    attributes = {"xyz": (x / METRE, y / METRE, z / METRE), "rpy": (rx, ry, rz)}
    tag = TAG.match(content, joint.start if joint.origin_start is None else joint.origin_start)
    assert tag is not None  # the parser has found it there
    if joint.origin_start is None:
        new = " ".join(f'{key}="{_text(values)}"' for key, values in attributes.items())
        return content[: tag.end()] + f"<origin {new}/>".encode() + content[tag.end() :]
    element = tag[0]
    for key, values in attributes.items():
        element = _attribute(element, key.encode(), _text(values).encode())
    return content[: tag.start()] + element + content[tag.end() :]


def _text(values: tuple[float, float, float]) -> str:
    return " ".join(repr(value + 0.0) for value in values)


def _attribute(tag: bytes, key: bytes, value: bytes) -> bytes:
    """A tag with one attribute replaced or added."""
    match = re.search(rb"(?<=\s)" + key + rb"""\s*=\s*(?:"[^"]*"|'[^']*')""", tag)
    new = key + b'="' + value + b'"'
    if match:
        return tag[: match.start()] + new + tag[match.end() :]
    end = len(tag) - (2 if tag.endswith(b"/>") else 1)
    return tag[:end].rstrip() + b" " + new + tag[end:]
