"""One plan being touched, over as many runs as it takes: touches.csv, and the journal that it can be rebuilt from."""

import csv
import hashlib
import io
import os
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from jaxtyping import Float

from identify.model.cell import Cell
from identify.model.files import InputError, Mistake, write_text
from identify.model.io.tables import plan_text, touch_columns, touches_text
from identify.model.touch import HIT, Plan, Touches
from probe.line.clock import Clock
from probe.line.controller import Contact
from probe.runs.journal import Journal, Record, read_records, sync_folder
from probe.runs.lock import Lock
from probe.runs.records import AGAIN, Intent, Result, result_of


class Session:
    """The touches of one plan; exclusive, resumable, never a touch lost nor doubled. Use as a context manager.

    A result is synced to the journal first and to touches.csv next, and both before the next motion; opening a session
    completes touches.csv from the journal. `repaired` says in a sentence what had to be put right.
    """

    def __init__(self, path: Path, cell: Cell, plan: Plan, *, resume: bool = False, clock: Clock | None = None) -> None:
        self.path = path
        self.cell = cell
        self.plan = plan
        self.repaired = ""
        self.results: dict[str, Result] = {}
        self.boot = ""  # start of the controller in which its position was last known to be right
        self.intent: Intent | None = None  # the last motion that was asked for
        self.search: Intent | None = None  # the last search, while nothing has come of it
        self.contact: Contact | None = None  # what that search met, as far as it was heard
        self._clock = clock or Clock()
        self._header = ",".join(touch_columns(cell.robot))
        self._lines: list[str] = []
        self._lock = Lock(path.with_suffix(".lock"))
        try:
            self._journal = Journal(journal_path(path))
        except BaseException:
            self._lock.release()
            raise
        try:
            self._open(resume)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the files and let others at them."""
        self._journal.close()
        self._lock.release()

    def intend(self, intent: Intent) -> None:
        """Write down a motion before it is asked for."""
        record: Record = {"kind": "intent", "do": intent.kind, "id": intent.id, "boot": intent.boot}
        record |= {"seq": intent.sequence, "rate_deg_s": float(np.degrees(intent.rate))}
        self._append(record | {k: self._out(getattr(intent, k)) for k in ("start", "end", "back")})

    def latched(self, contact: Contact) -> None:
        """Write down what the last search met, before the robot retracts."""
        record: Record = {"kind": "latch", "boot": contact.boot, "seq": contact.sequence}
        self._append(record | {"q": self._out(contact.q), "stop": self._out(contact.stop)})

    def rejected(self, reason: str) -> None:
        """Write down that nothing came of the last search."""
        self._append({"kind": "rejected", "reason": reason})

    def trusted(self, boot: str) -> None:
        """Write down that in this start of the controller its position is right."""
        self._append({"kind": "boot", "boot": boot})

    def finish(self, result: Result) -> None:
        """Write down what came of a touch, in the journal and as a row of touches.csv."""
        record: Record = {"kind": "result", "id": result.id, "line": self._line(result)}
        record["velocity"] = self._out(result.reading.velocity)
        if result.fast is not None:
            record |= {"fast_q": self._out(result.fast.q), "fast_velocity": self._out(result.fast.velocity)}
        self._append(record)
        with self.path.open("ab") as file:
            file.write((record["line"] + "\n").encode())
            file.flush()
            os.fsync(file.fileno())

    def hits(self) -> list[Result]:
        """The touches that count, in the order in which they were made."""
        return [result for result in self.results.values() if result.status == HIT]

    def _open(self, resume: bool) -> None:
        if all(map(_is_nothing, self._journal.records)) and not self._rows_on_disk():
            self._journal.clear()
        if not self._journal.records:
            self._refuse_foreign_rows()
            self._append(self._birth())
        elif not resume:
            text = f"{len(self._journal.records)} records of an earlier run; go on with --resume, or write elsewhere"
            raise InputError([Mistake(str(journal_path(self.path)), 0, text)])
        else:
            self._refuse_other_plan()
            for record in self._journal.records:
                self._take(record)
        self._repair()

    def _rows_on_disk(self) -> bool:
        return self.path.exists() and len(self.path.read_bytes().split(b"\n")) > 2

    def _refuse_foreign_rows(self) -> None:
        """Rows that no journal knows of belong to somebody else."""
        if self._rows_on_disk():
            raise InputError(
                [Mistake(str(self.path), 0, "it holds touches but has no journal; write elsewhere with -o")]
            )

    def _birth(self) -> Record:
        from importlib.metadata import version

        robot = self.cell.robot.name
        return {"kind": "plan", "plan": self._plan_hash(), "robot": robot, "columns": self._header} | {
            "touchcal": version("touchcal")
        }

    def _plan_hash(self) -> str:
        return hashlib.sha256(plan_text(self.plan, self.cell.robot).encode()).hexdigest()

    def _refuse_other_plan(self) -> None:
        birth, name = self._journal.records[0], str(journal_path(self.path))
        if birth.get("columns") != self._header:
            text = f"it is a session with the robot '{birth.get('robot')}', the cell has '{self.cell.robot.name}'"
            raise InputError([Mistake(name, 1, f"{text}; write elsewhere with -o")])
        if birth.get("plan") != self._plan_hash():
            text = "it is a session of another plan; give it the plan it was begun with, or write elsewhere with -o"
            raise InputError([Mistake(name, 1, text)])

    def _append(self, record: Record) -> None:
        self._journal.append(record | {"time": self._clock.stamp()})
        self._take(record)

    def _take(self, record: Record) -> None:
        """Bring a record of the journal back to life."""
        kind = record["kind"]
        if kind == "intent":
            start, end, back = (self._in(record[k]) for k in ("start", "end", "back"))
            rate = float(np.radians(record["rate_deg_s"]))
            self.intent = Intent(record["do"], record["id"], record["boot"], record["seq"], start, end, back, rate)
        elif kind == "latch":
            self.contact = Contact(self._in(record["q"]), self._in(record["stop"]), record["boot"], record["seq"])
        elif kind == "boot":
            self.boot = record["boot"]
        elif kind == "result":
            result = result_of(record, self.cell.robot)
            self.results[result.id] = result
            self._lines.append(record["line"])
        if kind in ("result", "rejected") or (kind == "intent" and record["do"] != "retract"):
            self.search = self.intent if kind == "intent" and record["do"] == "search" else None
            self.contact = None

    def _repair(self) -> None:
        """Make touches.csv what the journal says it is."""
        wanted = "".join(line + "\n" for line in [self._header, *self._lines])
        found = self.path.read_bytes() if self.path.exists() else b""
        if found == wanted.encode():
            return
        if not wanted.encode().startswith(found):
            kept = self.path.with_name(self.path.name + ".bak")
            kept.write_bytes(found)
            adopted = self._adopt(found.decode("utf-8", "replace"))
            wanted += "".join(line + "\n" for line in adopted)
            self.repaired = f"{self.path} was not what its journal says: written anew, the old one is {kept.name}"
        elif found:
            self.repaired = f"{self.path} was cut short: completed from its journal"
        write_text(self.path, wanted)
        sync_folder(self.path)

    def _adopt(self, text: str) -> list[str]:
        """Whole rows of this plan that only touches.csv knows: no touch is lost, whichever file suffered."""
        if not text.startswith(self._header + "\n"):
            return []
        adopted = []
        for line in text.split("\n")[1:-1]:
            name = line.split(",")[0]
            fits = len(next(csv.reader([line]), [])) == len(touch_columns(self.cell.robot))
            if fits and name not in self.results and name.partition(AGAIN)[0] in self.plan.ids:
                self._append({"kind": "result", "id": name, "line": line, "source": self.path.name})
                adopted.append(line)
        return adopted

    def _line(self, result: Result) -> str:
        none = np.full((1, 3), np.nan)
        note = " ".join(result.note.split())  # one row is one line
        row = Touches(
            (result.id,), (result.face,), result.reading.q[None], none, none[0, :1], none[0, :1], (result.status,),
            np.array([result.temperature]), (result.time,), (note,), self.plan.approach[[self._place(result.id)]],
        )  # fmt: skip
        return touches_text(row, self.cell.robot).split("\n")[1]

    def _place(self, name: str) -> int:
        """Where the point of a touch stands in the plan."""
        return self.plan.ids.index(name.partition(AGAIN)[0])

    def _out(self, q: Float[np.ndarray, " joints"]) -> list[float]:
        return (q / self.cell.robot.joint_unit()).round(9).tolist()

    def _in(self, values: list[float]) -> Float[np.ndarray, " joints"]:
        return np.array(values) * self.cell.robot.joint_unit()


def _is_nothing(record: Record) -> bool:
    """Whether a record tells of nothing that happened: a run that ended before the robot went anywhere."""
    return record["kind"] in ("plan", "boot") or (record["kind"] == "intent" and record["start"] == record["end"])


def journal_path(touches: Path) -> Path:
    """The journal that stands beside touches.csv."""
    return touches.with_suffix(".journal")


def rebuilt(journal: Path) -> str:
    """The text of touches.csv as its journal has it."""
    records, _ = read_records(journal)
    if not records:
        raise InputError([Mistake(str(journal), 0, "it holds no whole record; was it a journal of touchcal?")])
    out = io.StringIO()
    out.write(records[0]["columns"] + "\n")
    out.writelines(record["line"] + "\n" for record in records if record["kind"] == "result")
    return out.getvalue()
