"""ABB modules as text, and a reader of their numbers."""

import re

import numpy as np
from hypothesis import strategies as st
from programs import EXACT, Q, base_T_tip, from_quaternion, joints, quaternion, sides

from identify.model.frames import inverse, transform
from identify.programs.fixing import fix

NUMBER = r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?"


EAX = "[9E9,9E9,9E9,9E9,9E+09,9E9]"


def listed(values, digits):
    return "[" + ",".join(f"{v:.{digits}f}" for v in values) + "]"


def confdata(q):
    side = sides(q)
    quadrants = [int(np.floor(np.degrees(q[i]) / 90)) for i in (0, 3, 5)]
    return [*quadrants, (1 if q[4] < 0 else 0) + (0 if side.above else 2) + (0 if side.front else 4)]


def target(q, T=None, mm=3, unit=9, conf=None):
    values = quaternion(base_T_tip(q) if T is None else T)
    flags = ",".join(map(str, confdata(q) if conf is None else conf))
    return f"[{listed(values[:3], mm)},{listed(values[3:], unit)},[{flags}],{EAX}]"


def joint_target(q):
    return f"[{listed(np.degrees(q), 4)},{EAX}]"


def pose(T):
    values = quaternion(T)
    return f"{listed(values[:3], 6)},{listed(values[3:], 9)}"


def tooldata(name, T, hold="TRUE"):
    return f"PERS tooldata {name}:=[{hold},[{pose(T)}],[2.5,[0,0,80],[1,0,0,0],0,0,0]];"


def wobjdata(name, T, head='FALSE,TRUE,""'):
    half = transform(np.array([10.0, 0, 0, 0, 0, 0.5]))
    return f"TASK PERS wobjdata {name} := [{head},[{pose(T @ half)}],[{pose(inverse(half))}]];"


def module(*lines, end="\n"):
    return end.join(["%%%", "  VERSION:1", "%%%", "MODULE Seam", *lines, "ENDMODULE", ""])


def fixed(text, calibration=EXACT, setup=None):
    return fix(calibration, {"seam.mod": text.encode("latin-1")}, setup)[0]


def read(text, name):
    """Numbers behind a name, in their order: a reader of its own."""
    return np.array([float(v) for v in re.findall(NUMBER, text[text.index(name) + len(name) :])[:17]])


def told(result, name):
    return from_quaternion(read(result.after.decode("latin-1"), name)[:7])


remark = st.text("abc [],;:=!ä0", max_size=10)


@st.composite
def programs(draw, most=4):
    """A module and what it holds."""
    end, lines, drawn = draw(st.sampled_from(["\n", "\r\n"])), [], []
    for i in range(draw(st.integers(1, most))):
        q, kind = draw(joints), draw(st.sampled_from(["robtarget", "jointtarget", "inline", "short"]))
        scope = draw(st.sampled_from(["CONST", "LOCAL PERS", "VAR", "TASK PERS"]))
        text = joint_target(q) if kind == "jointtarget" else target(q, mm=draw(st.integers(2, 7)))
        gap = draw(st.sampled_from(["", " ", end + "    "]))
        text = text.replace("],[", f"],{gap}[") if kind == "robtarget" else text
        text = target(q, mm=0, unit=6) if kind == "short" else text
        line = f"{scope} {'robtarget' if kind == 'short' else kind} p{i}_ := {text};"
        line = f"MoveL {text},v100,fine,tool1;" if kind == "inline" else line
        lines += [line + f" !{draw(remark)}", f'TPWrite "p{i}_ := {draw(st.text("[]a", max_size=4))}";']
        drawn.append((kind, q))
    return module(*lines, end=end), drawn


WHOLE = module(f"CONST robtarget p1:={target(Q)};", f"PERS jointtarget j:={joint_target(Q)};", "MoveL p1,v1,z1,tool1;")
