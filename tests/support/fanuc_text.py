"""FANUC programs as text, and a reader of their numbers."""

import re

import numpy as np
from hypothesis import strategies as st
from programs import EXACT, Q, base_T_tip, joints, sides, wpr

from identify.programs.fixing import fix

VALUE = re.compile(r"([XYZWPR]|J\d)\s*=\s*(-?\d*\.\d+)")


def number(value):
    """As the controller writes it: no zero before the point, nine wide."""
    text = f"{value:.3f}"
    return (text.replace("0.", ".", 1) if abs(value) < 1 and text not in {"0.000"} else text).rjust(9)


def config(q):
    side, turns = sides(q), ", ".join(str(int(np.round(np.degrees(a) / 360))) for a in q[3:])
    return f"'{'F' if q[4] > 0 else 'N'} {'U' if side.above else 'D'} {'T' if side.front else 'B'}, {turns}'"


def pose_text(q, frame=0, tool=1, T=None, end="\n"):
    x, y, z, r, p, w = wpr(base_T_tip(q) if T is None else T)
    return (
        f"\tUF : {frame}, UT : {tool},\t\tCONFIG : {config(q)},{end}"
        f"\tX = {number(x)}  mm,\tY = {number(y)}  mm,\tZ = {number(z)}  mm,{end}"
        f"\tW = {number(w)} deg,\tP = {number(p)} deg,\tR = {number(r)} deg"
    )


def joint_text(q, end="\n"):
    d = np.degrees(q) - np.array([0, 0, np.degrees(q[1]), 0, 0, 0])  # joint 3 against the horizontal
    cells = [f"J{i + 1}= {number(v)} deg" for i, v in enumerate(d)]
    return f"\tUF : 0, UT : 1,\t{end}\t{f',{end}	'.join([', '.join(cells[:3]), ', '.join(cells[3:])])}"


def program(positions, motions="", end="\n"):
    points = [f"P[{i}]{{{end}   GP1:{end}{body}{end}}};" for i, body in enumerate(positions, 1)]
    head = ["/PROG  SEAM", "/ATTR", 'COMMENT\t\t= "P[1]{";', "/MN", *motions.splitlines(), "/POS"]
    return end.join([*head, *points, "/END", ""])


def read(text):
    """Numbers of every group by their letters, position by position: a reader of its own."""
    bodies = re.findall(r"P\[\d+[^{]*\{(.*?)\};", text[text.index("/POS") :], re.DOTALL)
    groups = [re.split(r"GP(\d+):", body)[1:] for body in bodies]
    return [{int(g[i]): {k: float(v) for k, v in VALUE.findall(g[i + 1])} for i in range(0, len(g), 2)} for g in groups]


def fixed(text, calibration=EXACT, setup=None):
    return fix(calibration, {"seam.ls": text.encode("latin-1")}, setup)[0]


comment = st.text("abc ä:;{}/0123456789=-", max_size=12).map(str.strip)


end_of_line = st.sampled_from(["\n", "\r\n"])


@st.composite
def positions(draw):
    """Text of one position and what it holds: how it is written, and the joints it stands for."""
    q = draw(joints)
    kind = draw(st.sampled_from(["pose", "joints", "untaught", "pose"]))
    name = draw(st.none() | comment)
    extra = draw(st.sampled_from(["", ",\tE1=   100.000  mm"]))
    group2 = draw(st.booleans())
    return kind, q, name, extra if kind == "pose" else "", group2


@st.composite
def programs(draw):
    end = draw(end_of_line)
    drawn = draw(st.lists(positions(), min_size=1, max_size=4))
    points = []
    for i, (kind, q, name, extra, group2) in enumerate(drawn, 1):
        body = joint_text(q, end) if kind == "joints" else pose_text(q, end=end) + extra
        body = re.sub(r"-?\d*\.\d{3}(?= )", "********", body) if kind == "untaught" else body
        second = f"{end}   GP2:{end}\tUF : 0, UT : 1,\t{end}\tJ1=    12.500 deg,\tJ2=     -.250 deg" if group2 else ""
        label = "" if name is None else f':"{name}"'
        points.append(f"P[{i}{label}]{{{end}   GP1:{end}{body}{second}{end}}};")
    lines = ["/PROG  SEAM", "/ATTR", f'COMMENT\t\t= "{draw(comment)}";', "/MN", f"   1:  !{draw(comment)} ;", "/POS"]
    return end.join([*lines, *points, "/END", ""]), drawn


WHOLE = program([pose_text(Q), joint_text(Q)])
