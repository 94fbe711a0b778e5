"""Arms as their users write them: URDFs from the dimensions that their makers publish, in many manners of writing."""

from collections.abc import Iterable
from math import pi
from xml.sax.saxutils import quoteattr

FREE = 2 * pi
# kind, origin [m], turn [rad], axis, lower and upper limit [rad] or [m]: one line a joint, behind them the flange
R, P, F = "revolute", "prismatic", "fixed"
Row = tuple


def universal(d1, d2, a2, back, a3, d4, d5, d6) -> list[Row]:
    """An arm of Universal Robots, in the frames of its maker's own URDF."""
    return [
        (R, (0, 0, d1), (0, 0, 0), (0, 0, 1), -FREE, FREE),
        (R, (0, d2, 0), (0, pi / 2, 0), (0, 1, 0), -FREE, FREE),
        (R, (0, back, a2), (0, 0, 0), (0, 1, 0), -pi, pi),
        (R, (0, 0, a3), (0, pi / 2, 0), (0, 1, 0), -FREE, FREE),
        (R, (0, d4, 0), (0, 0, 0), (0, 0, 1), -FREE, FREE),
        (R, (0, 0, d5), (0, 0, 0), (0, 1, 0), -FREE, FREE),
        (F, (0, d6, 0), (-pi / 2, 0, 0)),
    ]


UR5 = universal(0.089159, 0.13585, 0.425, -0.1197, 0.39225, 0.093, 0.09465, 0.0823)
UR10 = universal(0.1273, 0.220941, 0.612, -0.1719, 0.5723, 0.1149, 0.1157, 0.0922)
IRB2400 = [
    (R, (0, 0, 0), (0, 0, 0), (0, 0, 1), -3.1416, 3.1416),
    (R, (0.1, 0, 0.615), (0, 0, 0), (0, 1, 0), -1.7453, 1.9199),
    (R, (0, 0, 0.705), (0, 0, 0), (0, 1, 0), -1.0472, 1.1345),
    (R, (0.258, 0, 0.135), (0, 0, 0), (1, 0, 0), -3.49, 3.49),
    (R, (0.497, 0, 0), (0, 0, 0), (0, 1, 0), -2.0944, 2.0944),
    (R, (0.085, 0, 0), (0, 0, 0), (1, 0, 0), -6.9813, 6.9813),
    (F, (0, 0, 0), (0, pi / 2, 0)),
]
MH5 = [
    (R, (0, 0, 0.33), (0, 0, 0), (0, 0, 1), -2.9670, 2.9670),
    (R, (0.088, 0, 0), (0, 0, 0), (0, 1, 0), -1.1344, 2.6179),
    (R, (0, 0, 0.31), (0, 0, 0), (0, -1, 0), -2.3736, 4.4505),
    (R, (0, 0, 0.04), (0, 0, 0), (-1, 0, 0), -3.3161, 3.3161),
    (R, (0.305, 0, 0), (0, 0, 0), (0, -1, 0), -2.1816, 2.1816),
    (R, (0.086, 0, 0), (0, 0, 0), (-1, 0, 0), -6.2831, 6.2831),
    (F, (0, 0, 0), (0, pi / 2, 0)),
]
PANDA = [
    (R, (0, 0, 0.333), (0, 0, 0), (0, 0, 1), -2.8973, 2.8973),
    (R, (0, 0, 0), (-pi / 2, 0, 0), (0, 0, 1), -1.7628, 1.7628),
    (R, (0, -0.316, 0), (pi / 2, 0, 0), (0, 0, 1), -2.8973, 2.8973),
    (R, (0.0825, 0, 0), (pi / 2, 0, 0), (0, 0, 1), -3.0718, -0.0698),
    (R, (-0.0825, 0.384, 0), (-pi / 2, 0, 0), (0, 0, 1), -2.8973, 2.8973),
    (R, (0, 0, 0), (pi / 2, 0, 0), (0, 0, 1), -0.0175, 3.7525),
    (R, (0.088, 0, 0), (pi / 2, 0, 0), (0, 0, 1), -2.8973, 2.8973),
    (F, (0, 0, 0.107), (0, 0, 0)),
]
SCARA = [
    (R, (0, 0, 0.392), (0, 0, 0), (0, 0, 1), -2.3, 2.3),
    (R, (0.325, 0, 0), (0, 0, 0), (0, 0, 1), -2.5, 2.5),
    (P, (0.275, 0, 0), (0, 0, 0), (0, 0, -1), 0, 0.3),
    (R, (0, 0, 0), (0, 0, 0), (0, 0, -1), -FREE, FREE),
    (F, (0, 0, -0.05), (pi, 0, 0)),
]
FIVE = [  # a roll is missing, as in small arms for teaching
    (R, (0, 0, 0.2), (0, 0, 0), (0, 0, 1), -2.9, 2.9),
    (R, (0.05, 0, 0.12), (0, 0, 0), (0, 1, 0), -1.9, 1.9),
    (R, (0, 0, 0.45), (0, 0, 0), (0, 1, 0), -2.4, 2.4),
    (R, (0, 0, 0.4), (0, 0, 0), (0, 1, 0), -2.0, 2.0),
    (R, (0, 0, 0.15), (0, 0, 0), (0, 0, 1), -3.1, 3.1),
    (F, (0, 0, 0.05), (0, 0, 0)),
]
TRACK = [(P, (0, 0, 0.3), (0, 0, 0), (0, 1, 0), -1.0, 1.0), *IRB2400]


def urdf(
    rows: Iterable[Row],
    name: str = "arm",
    links: str = "link_{}",
    joints: str = "joint_{}",
    base: str = "base_link",
    flange: str = "tool0",
    further: str = "",
    bodies: str = "",
) -> str:
    """The text of a URDF; a continuous joint has no limits."""
    rows, out, above = list(rows), [], base
    for i, (kind, xyz, rpy, *rest) in enumerate(rows, start=1):
        below = flange if i == len(rows) else links.format(i)
        moves = f"<axis xyz={_numbers(rest[0])}/>" if rest else ""
        if len(rest) == 3:
            moves += f'<limit lower="{rest[1]}" upper="{rest[2]}" effort="0" velocity="2.5"/>'
        out.append(
            f"<link name={quoteattr(above)}>{bodies}</link>\n"
            f"<joint name={quoteattr(joints.format(i))} type={quoteattr(kind)}>"
            f"<parent link={quoteattr(above)}/><child link={quoteattr(below)}/>"
            f"<origin xyz={_numbers(xyz)} rpy={_numbers(rpy)}/>{moves}</joint>\n"
        )
        above = below
    end = f"<link name={quoteattr(above)}/>\n{further}</robot>\n"
    return f'<?xml version="1.0"?>\n<robot name={quoteattr(name)}>\n{"".join(out)}{end}'


def _numbers(values: Iterable[float]) -> str:
    return quoteattr(" ".join(f"{value:.10g}" for value in values))


def fixed(name: str, parent: str, child: str, xyz=(0, 0, 0), rpy=(0, 0, 0)) -> str:
    """A further link that stands still on another."""
    return (
        f'<link name="{child}"/><joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f"<origin xyz={_numbers(xyz)} rpy={_numbers(rpy)}/></joint>\n"
    )


# frames as ROS-Industrial asks for them: base beside base_link, flange (x out of it) before tool0 (z out of it)
PAIR = fixed("base_link-base", "base_link", "base", (0, 0, 0.615)) + fixed(
    "flange-tool0", "flange", "tool0", (0, 0, 0), (0, pi / 2, 0)
)
FINGERS = (
    '<link name="left"/><link name="right"/>'
    '<joint name="grip" type="prismatic"><parent link="tool0"/><child link="left"/><axis xyz="0 1 0"/>'
    '<limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>\n'
    '<joint name="grip copy" type="prismatic"><parent link="tool0"/><child link="right"/><axis xyz="0 -1 0"/>'
    '<limit lower="0" upper="0.04" effort="1" velocity="1"/><mimic joint="grip"/></joint>\n'
)
ENDLESS = [("continuous", *row[1:4]) if row[0] == R else row for row in UR5]

ARMS = {
    "ur5": urdf(UR5, "ur5"),
    "ur10": urdf(UR10, "ur10"),
    "irb2400": urdf([*IRB2400[:-1], (F, (0, 0, 0), (0, 0, 0))], "irb2400", flange="flange", further=PAIR),
    "mh5": urdf(MH5, "mh5"),
    "panda": urdf(
        PANDA, "panda", links="panda_link{}", joints="panda_joint{}", base="panda_link0", flange="panda_hand"
    ),
    "scara": urdf(SCARA, "scara"),
    "five": urdf(FIVE, "five"),
    "track": urdf(TRACK, "track"),
    "endless": urdf(ENDLESS, "endless"),
    "fingers": urdf(MH5, "fingers", further=FINGERS),
    "spaces": urdf(IRB2400, "my arm", "Link {} of arm", "Axis {}", "The Base", "The Flange"),
}
