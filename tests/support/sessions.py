"""Three touches as a run writes them."""

from pathlib import Path

import numpy as np

from identify.model.touch import Plan
from probe.line.controller import Contact
from probe.runs.journal import read_records
from probe.runs.records import Intent, Reading, Result
from probe.runs.session import Session


def small_plan() -> Plan:
    """Three touches, each from an approach to a contact."""
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (3, 6))
    faces = ("top-low", "front-low", "top-high")
    return Plan(("a", "b", "c"), faces, np.zeros((3, 3)), np.eye(3), q, q + 0.1)


def touch(session: Session, name: str, status: str = "hit", note: str = "") -> None:
    """One touch as a run writes it."""
    i = session.plan.ids.index(name.partition("~")[0])
    q, approach = session.plan.q[i], session.plan.approach[i]
    session.intend(Intent("search", name, "B00T", 7, approach, q, approach, 0.1))
    session.latched(Contact(q, q, "B00T", 7))
    reading, quick = Reading(q, 0.01 * q), Reading(q + 1e-4, 0.03 * q)
    session.finish(Result(name, session.plan.face[i], status, reading, quick, "2026-01-01T00:00:00Z", 21.5, note))


def finish_all(session: Session) -> None:
    for name in session.plan.ids:
        if name not in session.results:
            touch(session, name)


def rows(path: Path) -> list[str]:
    return path.read_text().splitlines()[1:]


def names(path: Path) -> list[str]:
    return [row.split(",")[0] for row in rows(path)]


def rebuilt(journal: Path) -> str:
    """The text of touches.csv as its journal has it."""
    records = read_records(journal).records
    lines = dict[str, str]()
    for record in records:
        if record["kind"] == "result":
            lines[record["id"]] = record["line"]
        elif record["kind"] == "doubted":
            lines.pop(record["id"], None)
    return "".join(line + "\n" for line in [records[0]["columns"], *lines.values()])
