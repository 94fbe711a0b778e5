"""Where a URDF's arm begins and ends: the base link, and the flange by its geometry, for one who names neither."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.model.files import InputError, Mistake, nearest, read_text
from identify.model.frames import inverse
from identify.model.urdf.chain import direction, joints_above, links_of
from identify.model.urdf.document import Urdf, origin, parsed

BASES = (
    "base",
    "base_link",
)  # the frame that the controller counts from by ROS-Industrial's rule; else where it stands
FLANGES = ("tool0", "flange", "ee_link")
STRAIGHT = 0.999  # cosine of the angle by which the z axis of a flange may lean away from the last joint's axis
HAND = re.compile(r"gripper|finger|thumb|jaw|knuckle|hand", re.IGNORECASE)  # joints that grip, by their name
FITTED = re.compile(r"finger|thumb|jaw|knuckle|camera|sensor|range|accelerometer|imu|led_|motor", re.IGNORECASE)
XACRO, COMMENT = re.compile(r"\$\{|\$\(|<xacro:"), re.compile(r"<!--.*?-->", re.DOTALL)


@dataclass(frozen=True, eq=False)
class Ends:
    """The two links of an arm."""

    base: str
    flange: str
    outward: Float[np.ndarray, " 3"]  # unit vector from the wrist out of the flange, in the frame of the flange link
    why: str  # how the flange was chosen, in words


def urdf_file(path: Path) -> Path:
    """The URDF that a file or the folder of a package stands for; raises InputError where it is a xacro, or several."""
    if path.is_dir():
        files = [p for p in sorted(path.rglob("*.urdf")) if not any(part.startswith(".") for part in p.parts)]
        if len(files) == 1:
            return files[0]
        xacros = sorted(path.rglob("*.xacro"))
        if not files and xacros:
            raise InputError([Mistake(str(path), 0, f"the package holds xacro files only; {_expanded(xacros[0])}")])
        cure = f"name one of {', '.join(str(p) for p in files[:9])}" if files else "name a URDF"
        raise InputError([Mistake(str(path), 0, f"the folder holds {len(files)} URDFs; {cure}")])
    if path.suffix.lower() == ".xacro" or XACRO.search(COMMENT.sub("", read_text(path))):
        raise InputError([Mistake(str(path), 0, f"it is a xacro, not a URDF yet; {_expanded(path)}")])
    return path


def _expanded(path: Path) -> str:
    return f"expand it first: xacro {path} > {path.name.removesuffix('.xacro').removesuffix('.urdf')}.urdf"


def ends(path: Path, base: str | None = None, flange: str | None = None) -> Ends:
    """Base and flange of the arm in a URDF; those that are named are kept. Raises InputError where there is no arm."""
    urdf = parsed(path)
    above = joints_above(urdf)
    links = links_of(urdf, above)
    for role, name in (("base", base), ("flange", flange)):
        if name is not None and name not in links:
            urdf.wrong(None, f"no link '{name}' for the {role}{nearest(name, links)}")
    if urdf.mistakes:
        raise InputError(urdf.mistakes)
    tree = _Tree(urdf, links)
    flange, why = (flange, "as named") if flange is not None else tree.flange()
    if base is None:
        root = tree.climb(flange)[-1]
        rigid = tree.rigid(root)
        base = next((name for name in BASES if name in rigid), root)
    return Ends(base, flange, tree.outward(flange), why)


class _Tree:
    """The links of a URDF and the joints between them."""

    def __init__(self, urdf: Urdf, links: set[str]) -> None:
        self.urdf, self.links, self.above = urdf, links, joints_above(urdf)

    def climb(self, link: str) -> list[str]:
        """A link and those above it, up to the root."""
        links = [link]
        while links[-1] in self.above and len(links) <= len(self.links):
            links.append(self.above[links[-1]][0])
        return links

    def moving(self, link: str) -> bool:
        """Whether the joint above a link moves on its own."""
        joint = self.above[link][1] if link in self.above else None
        return joint is not None and joint.get("type") != "fixed" and joint.find("mimic") is None

    def carrier(self, link: str) -> str:
        """The nearest link at or above whose joint moves; the root where none does."""
        return next((name for name in self.climb(link) if self.moving(name)), self.climb(link)[-1])

    def rigid(self, link: str) -> list[str]:
        """The links that are fixed to one, itself among them, in the order of their names."""
        return sorted(name for name in self.links if self.carrier(name) == self.carrier(link))

    def joints(self, link: str) -> int:
        """How many joints move a link."""
        return sum(self.moving(name) for name in self.climb(link))

    def flange(self) -> tuple[str, str]:
        """The flange link, and how it was chosen."""
        arm = sorted(name for name in self.links if not self._gripping(name)) or sorted(self.links)
        named = [name for end in FLANGES for name in arm if name == end or name.endswith(f"_{end}")]
        named = [name for name in named if self.joints(name)]
        last = named[0] if named else max(arm, key=self._depth, default="")
        if not last or not self.joints(last):
            raise InputError([Mistake(self.urdf.file, 0, "no joint moves; is this the URDF of an arm?")])
        members = [name for name in self.rigid(last) if name in arm]
        members = [name for name in members if not FITTED.search(name)] or members
        straight = [name for name in members if self.outward(name)[2] > STRAIGHT]
        by_name = [name for name in named if name in straight]
        beyond = [
            (round(self._distance(name), 6), len(self.climb(name)), name)
            for name in straight
            if self._distance(name) > 1e-6
        ]
        at_wrist = [(0.0, -len(self.climb(name)), name) for name in straight]  # rather a frame on the last link
        if straight:
            return by_name[0] if by_name else min(beyond or at_wrist)[-1], "its z axis points out of the wrist"
        behind = sorted(
            (round(self._distance(name), 6), name) for name in members if self._along(name) > self._along(last) + 1e-6
        )
        flange = last if named or not behind else behind[0][1]
        return flange, "no frame behind the last joint has its z axis out of the wrist, this one is nearest behind it"

    def _gripping(self, link: str) -> bool:
        """Whether a finger carries a link: a joint that grips, or that follows another, stands above it."""
        joints = [self.above[name][1] for name in self.climb(link)[:-1]]
        moving = [joint for joint in joints if joint.get("type") != "fixed"]
        return any(joint.find("mimic") is not None or HAND.search(joint.get("name", "")) for joint in moving)

    def _along(self, link: str) -> float:
        """How far a link lies beyond the wrist along the axis of the last joint [mm]."""
        axis, along = self._last_axis(link)
        return along if self.outward(link) @ axis > 0 else -along

    def _depth(self, link: str) -> tuple[int, int]:
        """Joints that move a link, fingers (a slide at the end) not counted."""
        chain = [name for name in self.climb(link) if self.moving(name)]
        fingers = len(chain) > 3 and self.above[chain[0]][1].get("type") == "prismatic"
        return (len(chain) - 2 * fingers, -len(self.climb(link)))

    def outward(self, link: str) -> Float[np.ndarray, " 3"]:
        """The direction of the last joint's axis out of the wrist, in the frame of a link."""
        axis, along = self._last_axis(link)
        if abs(along) <= 1e-6:
            hangs = self._hangs(link, axis)
            return axis if hangs > 0 or (hangs == 0 and axis[2] >= 0) else -axis
        return axis if along > 0 else -axis

    def _hangs(self, link: str, axis: Float[np.ndarray, " 3"]) -> float:
        """Above 0 if an axis points down from a spindle that slides up and down, as of a SCARA; 0 if there is none."""
        slides = [self.above[name][1].get("type") == "prismatic" for name in self.climb(link) if self.moving(name)]
        down = -float((self._from(self.climb(link)[-1], link)[:3, :3] @ axis)[2])
        return down if any(slides[:2]) and abs(down) > STRAIGHT else 0.0

    def _distance(self, link: str) -> float:
        """How far a link's origin lies behind that of the link that the last joint moves [mm]."""
        return float(np.linalg.norm(self._from(self.carrier(link), link)[:3, 3]))

    def _last_axis(self, link: str) -> tuple[Float[np.ndarray, " 3"], float]:
        """The axis of the last joint in the frame of a link, and how far the link lies beyond the wrist [mm]."""
        carrier = self.carrier(link)
        if carrier not in self.above:
            return np.array([0.0, 0.0, 1.0]), 0.0
        axis = direction(self.urdf, self.above[carrier][1])
        carrier_T_link = self._from(carrier, link)
        before = next((name for name in self.climb(carrier)[1:] if self.moving(name)), self.climb(carrier)[-1])
        wrist = inverse(self._from(before, carrier))[:3, 3]
        return carrier_T_link[:3, :3].T @ axis, float(axis @ (carrier_T_link[:3, 3] - wrist))

    def _from(self, upper: str, lower: str) -> Float[np.ndarray, "4 4"]:
        """upper_T_lower while every joint reads zero, of a link at or below another."""
        if lower == upper:
            return np.eye(4)
        path: Sequence[str] = self.climb(lower)
        below = path[: path.index(upper)] if upper in path else path[:-1]
        T = np.eye(4)
        for name in reversed(below):
            T = T @ origin(self.urdf, self.above[name][1], f"joint of link '{name}'")
        if upper in path:
            return T
        rest: Float[np.ndarray, "4 4"] = inverse(self._from(path[-1], upper)) @ T
        return rest
