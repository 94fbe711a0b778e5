"""Mutations of every file that a command reads, and what a reader may do with them: read, or refuse in one sentence."""

import json
import re
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from virtual_support import make_plan

from identify.model.files import InputError
from identify.model.io.calibration_file import read_calibration
from identify.model.io.description import library, read_cell, read_jig, read_robot
from identify.model.io.measurements import read_measurements
from identify.model.io.poses import read_poses
from identify.model.io.tables import plan_text, read_plan, read_positions, read_touches
from identify.programs.setup import read_setups
from oed.campaigns.folder import Folder
from probe.runs.session import Session, journal_path
from studies.engine import read_table

PATIENCE = 20.0  # [s] for one file of a few kilobytes, on a machine that is busy
NUMBER = re.compile(rb"-?\d+\.\d+|-?\d+")
MUTATIONS = (
    "flip",
    "drop",
    "insert",
    "cut",
    "double line",
    "drop line",
    "swap lines",
    "underscore",
    "digits",
    "comma",
    "bom",
    "utf-16",
    "long name",
    "nan",
    "huge",
    "double column",
    "control",
    "deep",
)
NONSENSE = ("underscore", "digits", "comma")  # a number changed so must be refused, wherever a number is read
SETUP = """frames: {1: {x_mm: 800.5, y_mm: 0.25, z_mm: 400, rz_deg: 90}}
tools: {3: {z_mm: 410.5, ry_deg: -18.5}}
joints: {sign: {j3: -1}, coupled: true}
near_deg: [0.5, 0, 0, 0, -90.5, 0]
"""
BACKUP = """[*SYSTEM*]$MNUFRAME  Storage: SHADOW  Access: RW  : ARRAY[1,9] OF POSITION
    [1,1] =
  Group: 1   Config: N D B, 0, 0, 0
  X:   800.500   Y:  -120.250   Z:     -.750
  W:    10.000   P:     -.649   R:    90.000
[*SYSTEM*]$MNUTOOL  Storage: SHADOW  Access: RW  : ARRAY[1,10] OF POSITION
    [1,1] =
  Group: 1   Config: N D B, 0, 0, 0
  X:     0.000   Y:     0.000   Z:   410.000
  W:     0.000   P:   -18.000   R:     0.000
"""


class Files:
    """One sound file of each kind, and its reader."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.cell = folder, read_cell(library("cells")["arc-welder"])
        cell, robot = self.cell, self.cell.robot
        q = np.degrees(make_plan(cell, 6).q)
        names = ",".join(f"q{i + 1}_deg" for i in range(6))
        rows = [",".join(f"{value:.5f}" for value in row) for row in q]
        faces = [face.name for face in cell.jig.faces] if cell.jig else []
        touches = "".join(f"t{i},hit,{faces[i]},{row}\n" for i, row in enumerate(rows))
        positions = "".join(f"p{i},{row},{10.5 * i},20.25,30.125\n" for i, row in enumerate(rows))
        poses = "id,x_mm,y_mm,z_mm,rz_deg,ry_deg,rx_deg\n" + "a,100.5,100.25,50.125,0.5,180.0,0.25\n"
        texts: dict[str, tuple[str, Callable[[Path], Any]]] = {
            "cell.yaml": (library("cells")["arc-welder"].read_text(), read_cell),
            "robot.yaml": (library("robots")["arc-welder"].read_text(), read_robot),
            "jig.yaml": (library("jigs")["step-block"].read_text(), read_jig),
            "plan.csv": (plan_text(make_plan(cell, 6), robot), lambda path: read_plan(path, cell)),
            "touches.csv": (f"id,status,face,{names}\n{touches}", lambda path: read_touches(path, cell)),
            "positions.csv": (f"id,{names},x_mm,y_mm,z_mm\n{positions}", lambda path: read_positions(path, cell)),
            "measured.csv": (f"id,{names},x_mm,y_mm,z_mm\n{positions}", lambda path: read_measurements(path, cell)),
            "poses.csv": (poses, read_poses),
            "session.csv": ("", self._resume),
            "plan-1.json": ("", self._go_on),
            "setup.yaml": (SETUP, lambda path: read_setups([path], robot)),
            "sysframe.va": (BACKUP, lambda path: read_setups([path], robot)),
            "chunk.csv": ("touches,strategy,error_mm\n20,even,0.125\n40,optimal,0.062\n", read_table),
            "calibration.json": (json.dumps({"touchcal": "1", "parameters": [{"name": "j1.d"}]}), read_calibration),
        }
        self.texts = {name: text.encode() for name, (text, _) in texts.items()}
        self.readers = {name: reader for name, (_, reader) in texts.items()}
        plan = make_plan(cell, 2)
        with Session(folder / "kept.csv", cell, plan) as session:
            session.trusted("B")
            session.rejected("nothing")
        self.plan = plan
        self.stages = Folder(folder / "stages", cell, {})
        self.stages.path.mkdir()
        self.stages.keep_plan(1, plan, {"stage": 1, "approach_mm": 25.5, "travel_mm": 35.5})
        self.texts["plan-1.json"] = (self.stages.path / "plan-1.json").read_bytes()
        self.texts["session.csv"] = journal_path(folder / "kept.csv").read_bytes()

    def _resume(self, path: Path) -> Any:
        for old in self.folder.glob("resumed*"):
            old.unlink()
        table = self.folder / "resumed.csv"
        journal_path(table).write_bytes(path.read_bytes())
        with Session(table, self.cell, self.plan, resume=True) as session:
            return session.results

    def _go_on(self, path: Path) -> Any:
        (self.stages.path / "plan-1.json").write_bytes(path.read_bytes())
        planned = self.stages.planned(1)
        assert planned is not None
        return float(planned[1]["approach_mm"]), float(planned[1]["travel_mm"])

    def complaint(self, seed: int) -> str:
        """What a reader did with a mutated file that it may not do, or nothing."""
        rng = np.random.default_rng(seed)
        name, kind = str(rng.choice(list(self.texts))), str(rng.choice(MUTATIONS))
        content, changed = mutate(self.texts[name], kind, rng, csv=name.endswith(".csv"))
        path = self.folder / f"fuzzed-{name}"
        path.write_bytes(content)
        began = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self.readers[name](path)
        except InputError as error:
            words = str(error)
            if not words.strip() or len(words) > 20000 or "Traceback" in words:
                return f"{name}, {kind}: the sentence is '{words[:80]}'"
        except Exception as error:
            return f"{name}, {kind}: {type(error).__name__}: {str(error)[:120]}"
        else:
            numbers = name.endswith(".csv") and name not in (
                "session.csv",
                "plan.csv",
                "chunk.csv",
            )  # a study has words, too
            if kind in NONSENSE and changed and numbers:
                return f"{name}, {kind}: a number was read as something else"
        spent = time.perf_counter() - began
        return f"{name}, {kind}: took {spent:.0f} s" if spent > PATIENCE else ""


def mutate(content: bytes, kind: str, rng: np.random.Generator, *, csv: bool) -> tuple[bytes, bool]:
    """A file changed in one way, and whether a number with a decimal point was."""
    at = int(rng.integers(max(len(content), 1)))
    lines = content.splitlines(keepends=True) or [b""]
    n = int(rng.integers(len(lines)))
    numbers = [found for found in NUMBER.finditer(content) if b"." in found[0] and b"\n" in content[: found.start()]]
    number = numbers[int(rng.integers(len(numbers)))] if numbers else None
    match kind:
        case "flip":
            return content[:at] + bytes([content[at] ^ 1 << int(rng.integers(8))]) + content[at + 1 :], False
        case "drop":
            return content[:at] + content[at + int(rng.integers(1, 40)) :], False
        case "insert":
            return content[:at] + rng.bytes(int(rng.integers(1, 20))) + content[at:], False
        case "cut":
            return content[:at], False
        case "double line":
            return b"".join([*lines[: n + 1], *lines[n:]]), False
        case "drop line":
            return b"".join(lines[:n] + lines[n + 1 :]), False
        case "swap lines":
            rng.shuffle(lines)  # type: ignore[arg-type]
            return b"".join(lines), False
        case "bom":
            return b"\xef\xbb\xbf" + content, False
        case "utf-16":
            return content.decode("utf-8", "replace").encode("utf-16"), False
        case "long name":
            return content[:at] + b"n" * 5000 + content[at:], False
        case "double column" if csv and b"," in lines[0]:
            wide = [line.rstrip(b"\n") + b"," + line.split(b",")[0] + b"\n" for line in lines]
            return b"".join(wide), False
        case "control":
            return content[:at] + bytes([int(rng.integers(32))]) + content[at:], False
        case "deep":
            return content[:at] + b"[" * 3000 + content[at:], False
    if number is None:
        return content[:at], False
    old = number[0]
    new = {
        "underscore": old[:-1] + b"_" + old[-1:],
        "digits": old.decode().translate({48 + i: 0x660 + i for i in range(10)}).encode(),
        "comma": old.replace(b".", b",") if not csv else b'"' + old.replace(b".", b",") + b'"',
        "nan": b"nan",
        "huge": b"1e999",
    }.get(kind, b"")
    return content[: number.start()] + new + content[number.end() :], kind in NONSENSE
