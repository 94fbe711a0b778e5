"""KUKA programs as text, and a reader of their numbers."""

import re

import numpy as np
from hypothesis import strategies as st
from programs import EXACT, Q, base_T_tip, from_wpr, joints, sides, wpr

from identify.programs.fixing import fix

PAIR = re.compile(r"([XYZABC]|A\d) (-?\d+\.?\d*(?:E[-+]?\d+)?)", re.IGNORECASE)


def flags(q):
    side = sides(q)
    turn = sum(1 << i for i in range(6) if q[i] < 0)
    return (0 if side.front else 1) + (2 if side.above else 0) + (4 if q[4] < 0 else 0), turn


def pose(q, T=None, digits=6, tail=",E1 0.0,E2 0.0", status=True):
    names = zip("XYZABC", wpr(base_T_tip(q) if T is None else T), strict=True)
    s, t = flags(q)
    return "{" + ",".join(f"{n} {v:.{digits}f}" for n, v in names) + (f",S {s},T {t}" if status else "") + tail + "}"


def axes(q, digits=4):
    return "{" + ",".join(f"A{i + 1} {v:.{digits}f}" for i, v in enumerate(np.degrees(q))) + ",E1 0.0}"


def dat(*lines, end="\n"):
    return end.join(["&ACCESS RVP", "&COMMENT {X 1,", "DEFDAT SEAM", *lines, "ENDDAT", ""])


def src(*lines, end="\n"):
    return end.join(["&ACCESS RVP", "DEF SEAM( )", "; {X 1.0", *lines, "END", ""])


def fixed(text, calibration=EXACT, setup=None, **more):
    """The first of programs that are given together."""
    files = {"seam.dat" if "DEFDAT" in text else "seam.src": text} | {k.replace("_", "."): v for k, v in more.items()}
    return fix(calibration, {name: content.encode("latin-1") for name, content in files.items()}, setup)[0]


def read(text, line):
    """Numbers by name of the last structure in the first line that has a text: a reader of its own."""
    found = next(row for row in text.splitlines() if line in row).split(";")[0]
    return {k.upper(): float(v) for k, v in PAIR.findall(found[found.rindex("{") :])}


def told(result, line):
    new = read(result.after.decode("latin-1"), line)
    return from_wpr(np.array([new[k] for k in "XYZABC"]))


comment = st.text("abc {}[]=;:X1 ä", max_size=10)


@st.composite
def programs(draw, most=5):
    """A .dat file and what its lines hold."""
    end, lines, drawn = draw(st.sampled_from(["\n", "\r\n"])), [], []
    for i in range(draw(st.integers(1, most))):
        q, kind = draw(joints), draw(st.sampled_from(["E6POS", "POS", "FRAME", "E6AXIS", "missing", "accurate"]))
        text = axes(q) if kind == "E6AXIS" else pose(q, digits=draw(st.integers(3, 9)), status=kind != "FRAME")
        text = re.sub(r",B [^,]*", "", text) if kind == "missing" else text
        text = re.sub(r"S (\d+)", lambda s: f"S {int(s[1]) + 16}", text) if kind == "accurate" else text
        declared = kind if kind in {"POS", "FRAME", "E6AXIS"} else "E6POS"
        scope, remark = draw(st.sampled_from(["", "GLOBAL "])), draw(st.just("") | comment.map(";".__add__))
        lines.append(f"DECL {scope}{declared} XP{i}={text}{remark}")
        string = draw(st.text("a}{", max_size=3))
        lines.append(f'DECL FDAT FP{i}={{TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] "{string}"}}')
        drawn.append((kind, q))
    return dat(*lines, "DECL LDAT LCPDAT1={VEL 2.0,ACC 100.0,CB {AUX_PT {ORI #CONSIDER},X 1.0}}", end=end), drawn


WHOLE = dat(f"DECL E6POS XP1={pose(Q)}", f"DECL E6AXIS XP2={axes(Q)}", "DECL FDAT FP1={TOOL_NO 1,BASE_NO 0}")
