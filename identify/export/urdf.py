"""A calibrated URDF: the origins of an existing one corrected in place, or a plain one made from nothing.

Two links are added: touchcal_jig, which stands where the jig does, and touchcal_tip, the tip of the tool.
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identify.compensation.compensate import believed
from identify.export.chain import Transform, origins, segments, slack_of, turn_to
from identify.export.formats import Format, Forward, Original
from identify.export.urdf_text import Joint, UrdfText
from identify.model.files import InputError, read_text
from identify.model.frames import inverse, pose, transform
from identify.model.io.calibration_file import Calibration
from identify.model.kinematics import Kinematics
from identify.model.urdf.chain import read_urdf
from identify.model.urdf.document import METRE

JIG, TIP = "touchcal_jig", "touchcal_tip"
SAME = 1e-6  # [mm], of tips at joint values drawn within the limits


def write(calibration: Calibration, original: Original | None) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """The calibrated URDF."""
    if original is None:
        return {".urdf": _plain(calibration)}, (
            "a plain URDF was made; name the original with --urdf to keep its meshes",
        )
    return {".urdf": _corrected(calibration, original)}, ()


def read(files: Mapping[str, str], calibration: Calibration) -> Forward:
    """jig_T_tip of the URDF, by the reader of cells."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibrated.urdf"
        path.write_text(files[".urdf"], encoding="utf-8")
        robot = read_urdf(path, JIG, TIP)
    kinematics, theta = Kinematics(robot), robot.theta(np.zeros(6), np.zeros(6))

    def forward(q: Float[np.ndarray, "poses joints"]) -> Float[np.ndarray, "poses 4 4"]:
        T = np.tile(np.eye(4), (len(q), 1, 1))
        T[:, :3, 3], T[:, :3, :3] = kinematics.flange(q, theta)
        return T

    return forward


def corrected_origins(calibration: Calibration, original: Original) -> tuple[UrdfText, list[Joint], list[Transform]]:
    """A URDF, the joints of its chain in order, and their origins corrected; the flange's own comes last."""
    robot = calibration.cell.robot
    _same_robot(calibration, original)
    urdf = UrdfText(read_text(original.path))
    above, chain = urdf.path(original.base, original.flange)
    if climbed := [joint.name for joint in above if joint.moves]:
        cure = "leave out --urdf to write the chain as a plain URDF"
        raise InputError(f"{original.path}: the chain climbs through joint '{climbed[0]}'; {cure}")
    start = _product([inverse(joint.origin) for joint in above])
    moving = [i for i, joint in enumerate(chain) if joint.moves]
    edges = [-1, *moving]
    frames = [
        _product([joint.origin for joint in chain[a + 1 : b + 1]]) for a, b in zip(edges[:-1], moving, strict=True)
    ]
    frames[0] = start @ frames[0]
    turns = [turn_to(chain[i].axis) for i in moving]
    slack = slack_of(segments(robot, calibration.cell.theta), frames, turns)
    target_origins = origins(segments(robot, calibration.theta), slack, turns)
    target_origins[0] = inverse(start) @ target_origins[0]
    # of the fixed joints before a moving one none changes: the moving one takes it all
    before = [_product([joint.origin for joint in chain[a + 1 : b]]) for a, b in zip(edges[:-1], moving, strict=True)]
    own = [inverse(fixed) @ origin for fixed, origin in zip(before, target_origins[:-1], strict=True)]
    return urdf, [chain[i] for i in moving] + chain[moving[-1] + 1 :], [*own, target_origins[-1]]


def _corrected(calibration: Calibration, original: Original) -> str:
    """The text of a URDF with its origins corrected, everything else as it was."""
    urdf, joints, new_origins = corrected_origins(calibration, original)
    moving, behind = len(calibration.cell.robot.joints), joints[len(calibration.cell.robot.joints) :]
    changes = dict(zip(joints[:moving], new_origins[:moving], strict=True))
    rest = new_origins[-1]  # from the last moving joint to the flange
    if behind:
        changes[behind[0]] = rest @ inverse(_product([joint.origin for joint in behind[1:]]))
        rest = np.eye(4)
    text = urdf.changed(changes)
    base_T_jig = inverse(transform(calibration.theta[:6]))
    added = _fixed(JIG, original.base, base_T_jig) + _fixed(
        TIP, original.flange, rest @ transform(calibration.theta[-6:])
    )
    end = text.rindex("</robot>")
    return text[:end] + added + text[end:]


def _same_robot(calibration: Calibration, original: Original) -> None:
    """Refuse a URDF that is not the nominal robot of the calibration."""
    robot, other = calibration.cell.robot, read_urdf(original.path, original.base, original.flange)
    if robot.prismatic != other.prismatic:
        raise InputError(
            f"{original.path}: its joints are not those of robot '{robot.name}'; name the URDF of the cell"
        )
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (50, len(robot.joints)))
    theta = believed(calibration)
    apart = Kinematics(robot).flange(q, theta)[0] - Kinematics(other).flange(q, other.theta(theta[:6], theta[-6:]))[0]
    if np.abs(apart).max() > SAME:
        raise InputError(
            f"{original.path}: its flange is up to {np.abs(apart).max():.3g} mm from that of robot '{robot.name}' in "
            "the calibration; name the URDF that the cell was made with, uncorrected"
        )


def _product(transforms: list[Transform]) -> Transform:
    T = np.eye(4)
    for each in transforms:
        T = T @ each
    return T


def _fixed(name: str, parent: str, T: Transform) -> str:
    return (
        f'  <link name="{name}"/>\n  <joint name="{name}_joint" type="fixed">\n    <parent link="{parent}"/>\n'
        f'    <child link="{name}"/>\n    {origin_tag(T)}\n  </joint>\n'
    )


def origin_tag(T: Transform) -> str:
    """An origin element; metres and radians, shortest and exact."""
    x, y, z, rz, ry, rx = pose(T)
    numbers = [
        " ".join(repr(float(v) + 0.0) for v in triple) for triple in ((x / METRE, y / METRE, z / METRE), (rx, ry, rz))
    ]
    return f'<origin xyz="{numbers[0]}" rpy="{numbers[1]}"/>'


def _plain(calibration: Calibration) -> str:
    """A URDF of nothing but links and joints."""
    robot = calibration.cell.robot
    frames = origins(segments(robot, calibration.theta))
    lines = ['<?xml version="1.0"?>', f'<robot name="{robot.name}">', '  <link name="base_link"/>']
    parent = "base_link"
    for i, (joint, T) in enumerate(zip(robot.joints, frames[:-1], strict=True), 1):
        unit = METRE if joint.prismatic else 1.0
        limit = f'lower="{joint.lower / unit!r}" upper="{joint.upper / unit!r}" velocity="{joint.speed / unit!r}"'
        lines += [
            f'  <link name="link_{i}"/>',
            f'  <joint name="{joint.name}" type="{_kind(joint.prismatic)}">',
            f'    <parent link="{parent}"/>',
            f'    <child link="link_{i}"/>',
            f"    {origin_tag(T)}",
            '    <axis xyz="0 0 1"/>',
            f'    <limit {limit} effort="0"/>',
            "  </joint>",
        ]
        parent = f"link_{i}"
    flange = _fixed("flange", parent, frames[-1])
    jig = _fixed(JIG, "base_link", inverse(transform(calibration.theta[:6])))
    return (
        "\n".join(lines) + "\n" + flange + jig + _fixed(TIP, "flange", transform(calibration.theta[-6:])) + "</robot>\n"
    )


def _kind(prismatic: bool) -> str:
    return "prismatic" if prismatic else "revolute"


FORMAT = Format(".urdf", write, read)
