"""A seam of a thousand points, 17 of 100 in a frame that only a table names: untouched without it, whole with it."""

import re

import numpy as np
import pytest
from abb_text import EAX, confdata, listed
from fanuc_text import config, number
from kuka_text import flags
from oracle import forward
from programs import CELL, EXACT, FRAME, TRUTH, base_T_tip, from_quaternion, from_wpr, quaternion
from scipy.spatial.transform import Rotation
from yaskawa_text import rconf

from identify.model.frames import inverse, transform
from identify.model.ik import reach
from identify.programs.fixing import fix
from identify.programs.setup import Setup

POINTS = 1000
ENDS = np.array([[0.1, 0.2, -0.3, 0.4, 0.9, 0.3], [-0.2, 0.3, -0.4, 0.6, 1.0, 0.1]])
SEAM = ENDS[0] + np.linspace(0, 1, POINTS)[:, None] * (ENDS[1] - ENDS[0])
APART = np.arange(POINTS) % 100 < 17  # in the frame of the table
WANTED = np.array([base_T_tip(q) for q in SEAM])
WRITTEN = np.where(APART[:, None, None], inverse(FRAME) @ WANTED, WANTED)
EULER = np.hstack([WRITTEN[:, :3, 3], Rotation.from_matrix(WRITTEN[:, :3, :3]).as_euler("ZYX", degrees=True)])


def fanuc(n):
    lines = ["/PROG  SEAM", "/ATTR", "/MN"]
    lines += [f"{i:4d}:L P[{i}] 10mm/sec CNT100    ;" for i in range(1, n + 1)] + ["/POS"]
    for i, (q, (x, y, z, r, p, w)) in enumerate(zip(SEAM[:n], EULER[:n], strict=True)):
        lines += [f"P[{i + 1}]{{", "   GP1:", f"\tUF : {9 * APART[i]}, UT : 1,\t\tCONFIG : {config(q)},"]
        lines += [f"\tX = {number(x)}  mm,\tY = {number(y)}  mm,\tZ = {number(z)}  mm,"]
        lines += [f"\tW = {number(w)} deg,\tP = {number(p)} deg,\tR = {number(r)} deg", "};"]
    return {"seam.ls": "\n".join([*lines, "/END", ""])}


def fanuc_read(files):
    values = re.findall(r"([XYZWPR]) =\s*(-?\d*\.\d+)", files["seam.ls"])
    x, y, z, w, p, r = np.array([float(v) for _, v in values]).reshape(-1, 6).T
    return np.column_stack([x, y, z, r, p, w])


def kuka(n):
    dat, src = ["DEFDAT SEAM"], ["DEF SEAM( )"]
    for i, (q, values) in enumerate(zip(SEAM[:n], EULER[:n], strict=True)):
        s, t = flags(q)
        cells = ",".join(f"{name} {v:.6f}" for name, v in zip("XYZABC", values, strict=True))
        dat += [f"DECL E6POS XP{i}={{{cells},S {s},T {t},E1 0.0}}"]
        dat += [f"DECL FDAT FP{i}={{TOOL_NO 1,BASE_NO {9 * APART[i]},IPO_FRAME #BASE}}"]
        src += [f"FDAT_ACT=FP{i}", "BAS(#CP_PARAMS,0.01)", f"LIN XP{i} C_DIS"]
    return {"seam.dat": "\n".join([*dat, "ENDDAT", ""]), "seam.src": "\n".join([*src, "END", ""])}


def kuka_read(files):
    rows = re.findall(r"XP\d+=\{X (\S+?),Y (\S+?),Z (\S+?),A (\S+?),B (\S+?),C (\S+?),", files["seam.dat"])
    return np.array(rows, dtype=float)


def abb(n):
    lines = ["MODULE Seam", "  PROC main()"]
    for i, q in enumerate(SEAM[:n]):
        x = quaternion(WRITTEN[i])
        conf = ",".join(map(str, confdata(q)))
        there = f"[{listed(x[:3], 6)},{listed(x[3:], 9)},[{conf}],{EAX}]"
        lines.append(f"    MoveL {there},v10,z1,tTorch\\WObj:={'wSeam' if APART[i] else 'wobj0'};")
    return {"seam.mod": "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])}


def abb_read(files):
    rows = re.findall(r"\[\[(.*?)\],\[(.*?)\],\[", files["seam.mod"])
    poses = [from_quaternion(np.array([float(v) for v in ",".join(row).split(",")])) for row in rows]
    return np.array([[*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_euler("ZYX", degrees=True)] for T in poses])


def yaskawa(n):
    lines, before = ["/JOB", "//NAME SEAM", "//POS", f"///NPOS {n},0,0,0,0,0", "///TOOL 1"], None
    for i, (q, (x, y, z, rz, ry, rx)) in enumerate(zip(SEAM[:n], EULER[:n], strict=True)):
        head = ["///USER 9", "///POSTYPE USER"] if APART[i] else ["///POSTYPE ROBOT"]
        lines += [*head, "///RECTAN", rconf(q)] if head != before else []
        lines.append(f"C{i:05d}={x:.3f},{y:.3f},{z:.3f},{rx:.4f},{ry:.4f},{rz:.4f}")
        before = head
    lines += ["//INST", "///DATE 2024/05/06 10:11", "///ATTR SC,RW", "///GROUP1 RB1", "NOP"]
    return {"SEAM.JBI": "\n".join([*lines, *(f"MOVL C{i:05d} V=10.0" for i in range(n)), "END", ""])}


def yaskawa_read(files):
    rows = re.findall(r"^C\d+=(.*)$", files["SEAM.JBI"], re.MULTILINE)
    return np.array([row.split(",") for row in rows], dtype=float)[:, [0, 1, 2, 5, 4, 3]]


SEAMS = {  # writer, reader, the frame, and how many points: the first of the seam, so that the test is quick
    "fanuc": (fanuc, fanuc_read, "9", POINTS),
    "kuka": (kuka, kuka_read, "9", 200),
    "abb": (abb, abb_read, "wSeam", 200),
    "yaskawa": (yaskawa, yaskawa_read, "9", 200),
}


def fixed(files, **setup):
    results = fix(
        EXACT, {name: text.encode("latin-1") for name, text in files.items()}, Setup(near=ENDS.mean(axis=0), **setup)
    )
    return results, {result.name: result.after.decode("latin-1") for result in results}


@pytest.mark.parametrize("maker", SEAMS)
def test_a_seam_stays_as_it_is_until_the_frame_of_some_points_is_known_and_is_then_corrected_whole(maker):
    write, read, frame, n = SEAMS[maker]
    files = write(n)

    results, untouched = fixed(files, frames={"other": np.eye(4)})

    left = [mention for result in results for mention in result.failures]
    assert untouched == files
    assert not any(result.whole for result in results)
    assert len(left) == APART[:n].sum() == 0.17 * n
    assert all(f"frame {frame} is not in the table" in mention.why for mention in left)

    results, corrected = fixed(files, frames={frame: FRAME})

    assert all(result.whole and not result.failures for result in results)
    assert sum(len(result.shift) for result in results) == n
    said = jig_poses(read(files))
    assert np.abs(said[:, :3, 3] - (transform(CELL.theta[:6]) @ WANTED[:n])[:, :3, 3]).max() < 0.001  # as it is written
    assert off(jig_poses(read(corrected)), said) < 0.001
    assert off(said, said) > 1.0


def jig_poses(values):
    """Poses that a program says, in the jig."""
    told = np.array([from_wpr(row) for row in values])
    return transform(CELL.theta[:6]) @ np.where(APART[: len(told), None, None], FRAME @ told, told)


def off(told, wanted):
    """How far [mm] the true robot ends from poses at most where its controller is told others, by other kinematics."""
    found = reach(CELL.kinematics, CELL.theta, told[:, :3, 3], told[:, :3, :3], SEAM[: len(told)])
    assert found.reached().all()
    true = np.array([forward(CELL.robot, q, TRUTH)[:3, 3] for q in found.q])
    return np.linalg.norm(true - wanted[:, :3, 3], axis=1).max()
