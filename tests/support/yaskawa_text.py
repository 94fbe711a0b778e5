"""Yaskawa jobs as text, and a reader of their numbers."""

import re

import numpy as np
from hypothesis import strategies as st
from programs import EXACT, FRAME, Q, base_T_tip, from_wpr, joints, sides, wpr

from identify.model.frames import inverse
from identify.model.joint_counting import JointCounting
from identify.programs.fixing import fix
from identify.programs.setup import Setup

PULSES = np.array([1341.4, 1200.0, -1333.3, 900.1, 980.0, 512.5])


def rconf(q):
    side = sides(q)
    return f"///RCONF 1,{0 if side.above else 1},{0 if side.front else 1},0,0,0,0,0"


def pose(q, T=None, digits=(3, 4)):
    x, y, z, rz, ry, rx = wpr(base_T_tip(q) if T is None else T)
    return ",".join([f"{v:.{digits[0]}f}" for v in (x, y, z)] + [f"{v:.{digits[1]}f}" for v in (rx, ry, rz)])


def pulses(q):
    return ",".join(f"{v:.0f}" for v in np.degrees(q) * PULSES)


def job(*lines, end="\n", instructions=("MOVL C00000 V=11.0",)):
    head = ["/JOB", "//NAME SEAM", "//POS", f"///NPOS {len(lines)},0,0,0,0,0"]
    return end.join(
        [
            *head,
            *lines,
            "//INST",
            "///DATE 2024/05/06 10:11",
            "///ATTR SC,RW",
            "///GROUP1 RB1",
            "NOP",
            *instructions,
            "END",
            "",
        ]
    )


def fixed(text, calibration=EXACT, setup=Setup(near=Q)):  # noqa: B008
    content = text if isinstance(text, bytes) else text.encode("latin-1")
    return fix(calibration, {"SEAM.JBI": content}, setup)[0]


def read(text, name):
    """Numbers of the line of a position: a reader of its own."""
    line = next(row for row in re.split(r"\r?\n", text) if row.startswith(name + "="))
    return np.array([float(v) for v in line.split("=")[1].split(",")])


def told(result, name):
    x, y, z, rx, ry, rz = read(result.after.decode("latin-1"), name)[:6]
    return from_wpr(np.array([x, y, z, rz, ry, rx]))


@st.composite
def programs(draw, most=5):
    """A job and what its lines hold; the headers change where they must, and sometimes where they need not."""
    end, lines, drawn, header = draw(st.sampled_from(["\n", "\r\n"])), [], [], None
    for i in range(draw(st.integers(1, most))):
        q, kind = draw(joints), draw(st.sampled_from(["pose", "pulse", "user", "tool", "angle"]))
        head = {
            "pose": ["///TOOL 1", "///POSTYPE ROBOT", "///RECTAN", rconf(q)],
            "user": ["///USER 4", "///TOOL 1", "///POSTYPE USER", "///RECTAN", rconf(q)],
            "tool": ["///POSTYPE TOOL", "///RECTAN", rconf(q)],
            "pulse": ["///POSTYPE PULSE", "///PULSE"],
            "angle": ["///POSTYPE ANGLE", "///ANGLE"],
        }[kind]
        lines += head if head != header or draw(st.booleans()) else []
        header = head
        T = inverse(FRAME) @ base_T_tip(q) if kind == "user" else None
        angles = ",".join(f"{v:.4f}" for v in np.degrees(q))
        body = {"pulse": pulses(q), "angle": angles}.get(kind, pose(q, T))
        extra = draw(st.sampled_from(["", "", ",0.0000"])) if kind == "pose" else ""
        lines.append(f"C{i:05d}={body}{extra}")
        if draw(st.booleans()):
            lines += [f"EC{i:05d}=1000,-20"]
        drawn.append((kind, q))
    return job(*lines, end=end), drawn


SETUP = Setup({"4": FRAME}, joints=JointCounting(pulses=tuple(PULSES)), near=Q)


WHOLE = job(
    "///TOOL 1", "///POSTYPE ROBOT", "///RECTAN", rconf(Q), f"C00000={pose(Q)}", "///PULSE", f"C00001={pulses(Q)}"
)
