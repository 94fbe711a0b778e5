"""The stages of a campaign as files in a folder, and their touches made over a port."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from csv import DictReader
from dataclasses import replace
from hashlib import sha256
from json import JSONDecodeError, dumps, loads
from pathlib import Path
from typing import Any

import numpy as np

from identify.model.cell import Cell
from identify.model.files import InputError, Mistake, digest, read_text, write_json, write_text
from identify.model.io.calibration_file import Calibration, write_calibration
from identify.model.io.entries import cell_entry
from identify.model.io.tables import plan_text, read_plan, read_touches
from identify.model.touch import HIT, Plan, Touches, joined
from oed.campaigns.connection import Connection, Touching
from oed.campaigns.stages import Job
from probe import Settings
from probe.line.controller import InTheWay, TouchError
from probe.runs.events import Listener, ignore
from probe.runs.lock import Lock


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """The folder, for one campaign at a time; a disk that is full or read-only is said in one sentence."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}; choose another folder with -o") from None
    lock = Lock(folder / "campaign.lock")
    try:
        yield
    except OSError as error:
        if error.filename is None and error.strerror is None:
            raise
        raise InputError(
            f"{error.filename or folder}: cannot be written: {error.strerror}; make room, then give the same command "
            "again: it goes on where it stopped"
        ) from None
    finally:
        lock.release()


class Folder:
    """plan-1.csv, plan-1.json, touches-1.csv, calibration-1.json, plan-2.csv, ... of one cell."""

    def __init__(self, path: Path, cell: Cell, inputs: dict[str, str]) -> None:
        self.path, self.cell, self.inputs = path, cell, inputs

    def planned(self, number: int) -> tuple[Plan, dict[str, Any]] | None:
        """The plan of a stage; raises InputError where it belongs to another cell."""
        file = self.path / f"plan-{number}.json"
        if not file.exists():
            return None
        try:
            notes = loads(read_text(file))
            lengths, cell, inputs = (notes["approach_mm"], notes["travel_mm"]), notes["cell"], notes.get("inputs", {})
            sound = isinstance(inputs, dict) and all(0.0 < length < np.inf for length in lengths)
        except (JSONDecodeError, RecursionError, KeyError, TypeError):
            sound = False
        if not sound:
            raise InputError([Mistake(str(file), 0, f"not of a campaign; {ELSEWHERE}")])
        if cell != fingerprint(self.cell):
            raise InputError([Mistake(str(file), 0, f"the campaign in this folder is of another cell; {ELSEWHERE}")])
        plan = self.path / f"plan-{number}.csv"
        if inputs.get(plan.name) != digest(plan):
            raise InputError([Mistake(str(plan), 0, f"it was changed after it was planned; {ELSEWHERE}")])
        return read_plan(plan, self.cell), notes

    def keep_plan(self, number: int, plan: Plan, notes: dict[str, Any]) -> Plan:
        """Write the plan, and then what was noted: the plan counts from then on."""
        path = self.path / f"plan-{number}.csv"
        write_text(path, plan_text(plan, self.cell.robot))
        noted = notes | {"cell": fingerprint(self.cell), "touches": len(plan)}
        write_json(path.with_suffix(".json"), noted, self.inputs | {path.name: digest(path)})
        return read_plan(path, self.cell)

    def keep_calibration(self, number: int, calibration: Calibration) -> None:
        """Write what the touches so far tell."""
        names = [f"touches-{i}.csv" for i in range(1, number + 1)]
        inputs = self.inputs | {name: digest(self.path / name) for name in names}
        write_calibration(self.path / f"calibration-{number}.json", replace(calibration, inputs=inputs))


ELSEWHERE = "choose another folder with -o, or clear this one"


def fingerprint(cell: Cell) -> str:
    """SHA-256 of what a cell file says, but for the port."""
    entry = {key: value for key, value in cell_entry(cell).items() if key != "controller"}
    return sha256(dumps(entry, sort_keys=True).encode()).hexdigest()


def touches_of(path: Path, cell: Cell, plan: Plan) -> Touches | None:
    """The touches of a stage, where every one of its plan has its row."""
    if not path.exists():
        return None
    ids = {line.split(",")[0] for line in read_text(path).splitlines()}
    return _read(path, cell, plan) if set(plan.ids) <= ids else None


def _read(path: Path, cell: Cell, plan: Plan) -> Touches:
    """The touches that were tried: those that hit as they were measured, the others as they were planned."""
    hits = read_touches(path, cell, trust_units=True)
    status = {row["id"]: row["status"] for row in DictReader(read_text(path).splitlines())}
    tried = [i for i, name in enumerate(plan.ids) if status.get(name, HIT) != HIT]
    rest = plan.take(np.array(tried, dtype=int))
    none = np.full(len(rest), np.nan)
    return joined(
        hits,
        Touches(
            rest.ids,
            rest.face,
            rest.q,
            rest.normal,
            none,
            none,
            tuple(status[name] for name in rest.ids),
            none,
            ("",) * len(rest),
            ("",) * len(rest),
            rest.approach,
        ),
    )


def _run(job: Job, touching: Touching, settings: Settings, tell: Listener) -> None:
    """Make the touches; a search for the jig ends where it gets into the robot's way, and the next is planned anew."""
    try:
        touching.run(settings, tell)
    except InTheWay:
        if not (job.searching and touching.session.hits()):
            raise


def as_campaigns_say(text: str) -> str:
    """What a run says, where no option is needed to go on."""
    again = "the same command"
    return text.replace("--resume --trust-position", f"{again} and --trust-position").replace("--resume", again)


def over_port(
    folder: Path, cell: Cell, connection: Connection, settings: Settings, tell: Listener = ignore
) -> Callable[[Job], Touches]:
    """What makes the touches of a job over a port, into touches-N.csv; one that was interrupted goes on.

    A virtual robot scatters anew in each job: repeated noise would not average out.
    """

    def touch(job: Job) -> Touches:
        path = folder / f"touches-{job.number}.csv"
        touches = touches_of(path, cell, job.plan)
        if touches is not None:
            return touches
        patient = replace(settings, misses=len(job.plan) + 1, retries=0) if job.searching else settings
        try:
            anew = replace(connection, seed=connection.seed + job.number)
            with anew.session(cell, job.cell, job.plan, path, resume=True) as touching:
                _run(job, touching, patient, tell)
        except TouchError as error:
            raise TouchError(as_campaigns_say(str(error))) from None
        return _read(path, cell, job.plan)

    return touch
