"""Mutations of every file that a command reads, through the command itself: it works, or one sentence says why not."""

import contextlib
import csv
import io
import json
import os
import shutil
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from unittest.mock import patch

import numpy as np
from fuzz import MUTATIONS, NONSENSE, Files, mutate
from maker_bench import Bench, make
from touching import clear_plan

from identify.estimation.calibrate import CalibrationFailed
from identify.model.files import InputError
from identify.model.io.description import read_cell
from identify.model.io.tables import plan_text, read_plan
from oed.cli import main
from probe.line.controller import TouchError
from probe.programs.options import Options
from probe.virtual.truth import Truth

PATIENCE = 60  # [s] of the processor for one command
LONGEST = 20000  # characters of what is said
FIT = ("--errors", "none", "--keep")
LOCATE = ("locate", "calibration.json", "touches.csv", "--workpiece", "jig.yaml")
IMPORT = ("import", "posreg1.va", "numreg1.va", "--plan", "plan.csv", "--maker", "fanuc", "-o", "imported.csv")
PROGRAM = """/PROG  SEAM
/ATTR
/MN
   1:L P[1] 100mm/sec FINE    ;
/POS
P[1]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   400.000  mm,	Y =   100.000  mm,	Z =   200.000  mm,
	W =   180.000 deg,	P =     0.000 deg,	R =     0.000 deg
};
/END
"""


@dataclass(frozen=True)
class Command:
    """A command, the file of it that is mutated, and what it writes."""

    file: str
    words: tuple[str, ...]
    writes: tuple[str, ...] = ()
    weight: float = 1.0  # how often it is chosen: some take seconds


COMMANDS = (
    Command("cell.yaml", ("check",)),
    Command("robot.yaml", ("check",)),
    Command("jig.yaml", ("check",)),
    Command("pendant.csv", ("check", "--pendant", "pendant.csv"), weight=0.5),
    Command("touches.csv", ("verify", "calibration.json", "touches.csv"), weight=2.0),
    Command("positions.csv", ("verify", "calibration.json", "positions.csv"), weight=2.0),
    Command("touches.csv", ("identify", "touches.csv", "-o", "new.json", *FIT), ("new.json",), 0.05),
    Command("positions.csv", ("identify", "positions.csv", "-o", "new.json", *FIT), ("new.json",), 0.05),
    Command("poses.csv", ("compensate", "calibration.json", "poses.csv", "-o", "out.csv"), ("out.csv",), 2.0),
    Command("calibration.json", ("export", "calibration.json", "--format", "json", "-o", "out.json"), ("out.json",)),
    Command("calibration.json", ("export", "calibration.json", "--format", "urdf", "-o", "out.urdf"), ("out.urdf",)),
    Command("touches.csv", LOCATE, ("workpiece.json",)),
    Command("jig.yaml", LOCATE, ("workpiece.json",)),
    Command("SEAM.LS", ("fix", "calibration.json", "SEAM.LS", "-o", "fixed"), ("fixed/SEAM.LS",)),
    *(
        Command(name, ("fix", "calibration.json", "SEAM.LS", "--setup", name, "-o", "fixed"), ("fixed/SEAM.LS",))
        for name in ("setup.yaml", "sysframe.va")
    ),
    *(Command(name, IMPORT, ("imported.csv",), 0.5) for name in ("posreg1.va", "numreg1.va")),
    Command("plan.json", ("run", "plan.csv", "--port", "sim", "-o", "made.csv"), ("made.csv",), 0.2),
    Command("plan.csv", ("run", "plan.csv", "--port", "sim", "-o", "made.csv"), ("made.csv",), 0.3),
    Command("session.journal", ("run", "plan.csv", "--port", "sim", "-o", "session.csv", "--resume"), (), 0.3),
    Command("session.csv", ("run", "plan.csv", "--port", "sim", "-o", "session.csv", "--resume"), (), 0.3),
)


class Commands:
    """A folder of sound files, in which one is mutated at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.kept = folder, folder / "kept"
        self.kept.mkdir()
        sound = Files(folder)
        texts = {name: text for name, text in sound.texts.items() if name not in ("session.csv", "measured.csv")}
        cell = texts["cell.yaml"].decode()
        texts["cell.yaml"] = (
            cell.replace("library:arc-welder", "robot.yaml").replace("library:step-block", "jig.yaml").encode()
            + b"joints: {coupled: {}}\n"
        )
        texts["plan.csv"] = plan_text(clear_plan(sound.cell, 3), sound.cell.robot).encode()
        texts["pendant.csv"] = self._pendant(sound).encode()
        texts["SEAM.LS"] = PROGRAM.encode()
        texts["fit.csv"] = _turned(texts["positions.csv"].decode(), 0.25).encode()
        header, *rows = texts["touches.csv"].decode().splitlines()
        more = _turned("\n".join([header, *rows]), 0.5).splitlines()[1:]
        faces = [face.name for face in sound.cell.jig.faces] if sound.cell.jig else []
        cells = [line.split(",")[3:] for line in [*rows, *more]]
        lines = [",".join([f"t{i}", "hit", face, *q]) for i, (face, q) in enumerate(zip(faces, cells, strict=False))]
        texts["touches.csv"] = "".join(f"{line}\n" for line in [header, *lines]).encode()
        texts["plan.json"] = b'{"next": "touchcal identify TOUCHES"}'
        for name in ("calibration.json", "plan-1.json", "chunk.csv"):
            del texts[name]
        for name, text in texts.items():
            (self.kept / name).write_bytes(text)
        with self._here(self.kept):
            self._made("identify", "fit.csv", *FIT)
            self._log()
            self._made("run", "plan.csv", "--port", "sim", "-o", "session.csv")
        self.texts = {path.name: path.read_bytes() for path in self.kept.iterdir() if path.is_file()}

    def _log(self) -> None:
        """What the program of a maker logs of the plan."""
        cell = read_cell(self.kept / "cell.yaml")
        plan = read_plan(self.kept / "plan.csv", cell)
        for name, text in make(Bench(cell, plan, Truth(cell.theta)), "fanuc", self.folder, Options()).logs.items():
            (self.kept / name).write_text(text, newline="")

    def _pendant(self, sound: Files) -> str:
        lines = sound.texts["positions.csv"].decode().splitlines()
        return "\n".join([lines[0] + ",w_deg,p_deg,r_deg", *(line + ",10.5,20.5,30.5" for line in lines[1:])]) + "\n"

    def _made(self, *words: str) -> None:
        code, said, _ = self._run(words)
        assert code in (0, 1), said

    @contextlib.contextmanager
    def _here(self, folder: Path) -> Iterator[None]:
        before = Path.cwd()
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)

    def _run(self, words: tuple[str, ...]) -> tuple[object, str, BaseException | None]:
        """Exit code and words of a command in this process, and the error behind them."""
        out, err = io.StringIO(), io.StringIO()
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            patch.dict(os.environ, TOUCHCAL_DEBUG="1"),
        ):
            try:
                main(list(words))
            except SystemExit as stop:
                return stop.code, out.getvalue() + err.getvalue(), None
            except (InputError, CalibrationFailed, TouchError) as error:
                return 2 if isinstance(error, InputError) else 1, str(error), error
            except Exception as error:  # what would have been called unexpected
                return 1, err.getvalue(), error
        return 0, out.getvalue() + err.getvalue(), None

    def run(self, *words: str) -> tuple[object, str]:
        """Exit code and words of a command among the sound files."""
        with self._here(self.kept):
            code, said, _ = self._run(words)
        return code, said

    def complaint(self, seed: int) -> str:
        """What a command did with a mutated file that it may not do, or nothing."""
        rng = np.random.default_rng([seed, 5])
        weight = np.array([command.weight for command in COMMANDS])
        command = COMMANDS[int(rng.choice(len(COMMANDS), p=weight / weight.sum()))]
        kind = str(rng.choice(MUTATIONS))
        content, changed = mutate(self.texts[command.file], kind, rng, csv=command.file.endswith(".csv"))
        at = self.folder / "now"
        shutil.rmtree(at, ignore_errors=True)
        shutil.copytree(self.kept, at)
        (at / command.file).write_bytes(content)
        signal.signal(signal.SIGPROF, _too_long)
        signal.setitimer(signal.ITIMER_PROF, PATIENCE)
        try:
            with self._here(at):
                code, said, error = self._run(command.words)
                found = self._judge(command, kind, changed, code, said, error)
        except TimeoutError:
            found = f"took more than {PATIENCE} s"
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        return found and f"{' '.join(command.words)} with {command.file}, {kind}: {found}"

    def _judge(
        self, command: Command, kind: str, changed: bool, code: object, said: str, error: BaseException | None
    ) -> str:
        if error is not None and not isinstance(error, (InputError, CalibrationFailed, TouchError)):
            return f"{type(error).__name__}: {str(error)[:150]}"
        if code not in (0, 1, 2):
            return f"exit code {code}"
        if "Traceback" in said or len(said) > LONGEST:
            return f"it said {len(said)} characters: {said[:80]}"
        if code and not said.strip():
            return f"exit code {code} without a word"
        for name in command.writes:
            if code == 2 and Path(name).exists():
                return f"exit code 2, but {name} was written"
            if Path(name).exists() and not _is_whole(Path(name)):
                return f"{name} is half-written"
        read = command.file.endswith(".csv") and command.file not in ("session.csv", "plan.csv")
        if kind in NONSENSE and changed and read and code == 0:
            return "a number was read as something else"
        return ""


def _turned(text: str, degrees: float) -> str:
    """The rows of a table with the first joint turned."""
    header, *rows = text.splitlines()
    at = header.split(",").index("q1_deg")
    cells = [line.split(",") for line in rows]
    turned = [[*row[:at], f"{float(row[at]) + degrees:.5f}", *row[at + 1 :]] for row in cells]
    return "".join(",".join(row) + "\n" for row in [[header], *turned])


def _too_long(number: int, frame: FrameType | None) -> None:
    raise TimeoutError


def _is_whole(path: Path) -> bool:
    if path.suffix not in (".json", ".csv"):
        return path.stat().st_size > 0  # a program keeps every byte
    try:
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".json":
            return isinstance(json.loads(text), dict)
        return text.endswith("\n") and len({len(row) for row in csv.reader(text.splitlines())}) == 1
    except ValueError:
        return False
