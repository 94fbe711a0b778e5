"""One plan being touched, over as many runs as it takes: touches.csv, and the journal that it can be rebuilt from."""

import hashlib
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
from probe.runs.journal import Journal, Record, keep_copy, sync_folder, unwritable
from probe.runs.lock import Lock
from probe.runs.records import AGAIN, APPROACH, Intent, Observation, Result, result_of
from probe.runs.repair import listed, row_objection, sound_rows


class Session:
    """The touches of one plan; exclusive, resumable, never a touch lost nor doubled. Use as a context manager.

    A result is synced to the journal first and to touches.csv next, and both before the next motion; opening a session
    completes touches.csv from the journal. A session opens whatever happened to its files: what is broken is named in
    `repaired`, what is whole is kept, and a copy of what was found stays beside it.
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
        self.evidence: dict[str, Observation] = {}  # of that search, by place
        self.doubted: set[str] = set()  # touches that were taken back once
        self._clock = clock or Clock()
        self._header = ",".join(touch_columns(cell.robot))
        self._lines: dict[str, str] = {}  # rows of touches.csv by id
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

    def observed(self, observation: Observation) -> None:
        """Write down what the controller said while the robot stood still."""
        record: Record = {"kind": "seen", "at": observation.place, "boot": observation.boot}
        self._append(record | {"q": self._out(observation.q), "closed": bool(observation.closed)})

    def doubt(self, name: str, reason: str) -> None:
        """Take back a touch that later ones speak against: its row goes, the journal keeps it, it is touched again."""
        self._append({"kind": "doubted", "id": name, "reason": reason})
        self._write_table()

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
        try:
            with self.path.open("ab") as file:
                file.write((record["line"] + "\n").encode())
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise unwritable(self.path, error) from error

    def hits(self) -> list[Result]:
        """The touches that count, in the order in which they were made."""
        return [result for result in self.results.values() if result.status == HIT]

    def _open(self, resume: bool) -> None:
        if all(map(_is_nothing, self._journal.records)) and not self._rows_on_disk():
            self._journal.clear()
        if self._journal.broken:
            broken = f"{listed(self._journal.broken)}; what is whole is kept, a copy is {self._journal.copy}"
            self.repaired = f"{journal_path(self.path)} was damaged: {broken}"
        if not (self._journal.records or (resume and self._rows_on_disk())):
            self._refuse_foreign_rows()
            self._append(self._birth())
        elif not resume:
            text = f"{len(self._journal.records)} records of an earlier run; go on with --resume, or write elsewhere"
            raise InputError([Mistake(str(journal_path(self.path)), 0, text)])
        else:
            self._revive()
        self._repair()

    def _revive(self) -> None:
        """Take every record of the journal that fits; a journal without its first record is given one."""
        records, unfit = list(self._journal.records), list[str]()
        if records and records[0].get("kind") == "plan":
            self._refuse_other_plan()
        else:
            self._append(self._birth())
        for place, record in enumerate(records, 1):
            try:
                if record["kind"] == "result" and (reason := row_objection(record["line"], self.cell, self.plan)):
                    raise ValueError(reason)
                self._take(record)
            except (KeyError, TypeError, ValueError, IndexError) as error:
                unfit.append(f"record {place} does not fit ({error})")
        if unfit:
            self._add_repair(f"{journal_path(self.path)}: {listed(unfit)}; left out")
        if (self._journal.broken or unfit) and self.search is not None:
            self.rejected("the journal was damaged: the evidence for this touch may be missing")

    def _rows_on_disk(self) -> bool:
        return self.path.exists() and len(self.path.read_bytes().split(b"\n")) > 2

    def _refuse_foreign_rows(self) -> None:
        """Rows that no journal knows of belong to somebody else."""
        if self._rows_on_disk():
            text = (
                "it holds touches but has no journal; say --resume if they are of this plan, or write elsewhere with -o"
            )
            raise InputError([Mistake(str(self.path), 0, text)])

    def _add_repair(self, text: str) -> None:
        self.repaired = "; ".join(filter(None, (self.repaired, text)))

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
        elif kind == "seen":
            at, closed = record["at"], bool(record["closed"])
            self.evidence[at] = Observation(at, record["boot"], self._in(record["q"]), closed)
        elif kind == "doubted":
            self.doubted.add(record["id"])
            self.results.pop(record["id"], None)
            self._lines.pop(record["id"], None)
        elif kind == "boot":
            self.boot = record["boot"]
        elif kind == "result":
            result = result_of(record, self.cell.robot)
            self.results[result.id] = result
            self._lines[result.id] = record["line"]
        if kind in ("result", "rejected") or (kind == "intent" and record["do"] != "retract"):
            do = record["do"] if kind == "intent" else ""
            self.search, self.contact = (self.intent if do == "search" else None), None
            searching = do in ("search", "fast")
            self.evidence = {k: v for k, v in self.evidence.items() if searching and k == APPROACH}

    def _repair(self) -> None:
        """Make touches.csv what the journal says it is, and adopt whole rows that only touches.csv knows."""
        content = self.path.read_bytes() if self.path.exists() else b""
        if content == self._table().encode():
            return
        if not self._table().encode().startswith(content):
            copy, header = keep_copy(self.path), self._header
            text = content.decode("utf-8", "replace") + "\n" * (not content.endswith(b"\n"))
            adopted, broken = sound_rows(text, header, self.cell, self.plan, {*self.results, *self.doubted})
            for line in adopted:
                self._append({"kind": "result", "id": line.split(",")[0], "line": line, "source": self.path.name})
            named = f": {listed(broken)}" if broken else ""
            self._add_repair(
                f"{self.path} was not what its journal says{named}: written anew, the old one is {copy.name}"
            )
        elif content:
            self._add_repair(f"{self.path} was cut short: completed from its journal")
        self._write_table()

    def _table(self) -> str:
        return "".join(line + "\n" for line in [self._header, *self._lines.values()])

    def _write_table(self) -> None:
        write_text(self.path, self._table())
        sync_folder(self.path)

    def _line(self, result: Result) -> str:
        none = np.full((1, 3), np.nan)
        note = " ".join(result.note.split())  # one row is one line
        row = Touches(
            (result.id,),
            (result.face,),
            result.reading.q[None],
            none,
            none[0, :1],
            none[0, :1],
            (result.status,),
            np.array([result.temperature]),
            (result.time,),
            (note,),
            self.plan.approach[[self._place(result.id)]],
        )
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
    kind = record.get("kind")
    return kind in ("plan", "boot") or (kind == "intent" and record["start"] == record["end"])


def journal_path(touches: Path) -> Path:
    """The journal that stands beside touches.csv."""
    return touches.with_suffix(".journal")
