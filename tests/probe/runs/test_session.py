"""The journal and touches.csv: cut at every byte, damaged, edited, locked; no touch is lost, none is doubled."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sessions import finish_all, names, rebuilt, rows, small_plan, touch
from touching import Ticks

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.tables import read_touches, touch_columns
from identify.model.touch import Plan
from probe.line.controller import Contact
from probe.runs.journal import Journal, record_of
from probe.runs.records import Intent
from probe.runs.session import Session, journal_path

pytestmark = pytest.mark.usefixtures("unsynced")
BACKUP = "touches.csv.bak"


@pytest.fixture(scope="module")
def plan() -> Plan:
    return small_plan()


def test_a_run_leaves_a_table_that_the_vocabulary_reads(tmp_path: Path, arc_welder: Cell, plan: Plan) -> None:
    path = tmp_path / "touches.csv"
    with Session(path, arc_welder, plan) as session:
        touch(session, "a", note="two\nlines, and a comma")
        touch(session, "b", "miss")
        touch(session, "a~2")

    read = read_touches(path, arc_welder, trust_units=True)
    assert read.ids == ("a", "a~2")
    assert read.note[0] == "two lines, and a comma"
    assert read.temperature[0] == 21.5
    np.testing.assert_allclose(read.q[0], plan.q[0], atol=1e-10)
    assert path.read_text().splitlines()[0] == ",".join(touch_columns(arc_welder.robot))


def test_the_journal_alone_rebuilds_the_table(tmp_path: Path, arc_welder: Cell, plan: Plan) -> None:
    path = tmp_path / "touches.csv"
    with Session(path, arc_welder, plan) as session:
        finish_all(session)

    assert rebuilt(journal_path(path)) == path.read_text()


def test_everything_that_a_session_knows_is_known_again_after_opening_it(
    tmp_path: Path, arc_welder: Cell, plan: Plan
) -> None:
    path = tmp_path / "touches.csv"
    with Session(path, arc_welder, plan) as session:
        session.trusted("B00T")
        touch(session, "a")
        session.intend(Intent("search", "b", "B00T", 9, plan.approach[1], plan.q[1], plan.approach[1], 0.2))
        session.latched(Contact(plan.q[1], plan.q[1] + 1e-3, "B00T", 9))
        session.intend(Intent("retract", "b", "B00T", 10, plan.q[1], plan.approach[1], plan.approach[1], 0.2))

    with Session(path, arc_welder, plan, resume=True) as session:
        assert session.boot == "B00T"
        assert session.intent is not None
        assert session.search is not None
        assert session.contact is not None
        assert (session.intent.kind, session.search.sequence, session.contact.sequence) == ("retract", 9, 9)
        np.testing.assert_allclose(session.contact.stop, plan.q[1] + 1e-3, atol=1e-10)
        result = session.results["a"]
        np.testing.assert_allclose(result.reading.velocity, 0.01 * plan.q[0], atol=1e-10)
        assert result.fast is not None
        np.testing.assert_allclose(result.fast.q, plan.q[0] + 1e-4, atol=1e-10)
        session.rejected("why not")
        assert session.search is None


def test_a_result_is_on_the_disk_in_the_journal_and_then_in_the_table_before_the_call_returns(
    tmp_path: Path, arc_welder: Cell, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, synced = tmp_path / "touches.csv", list[tuple[int, int]]()

    def noted(handle: int) -> None:
        synced.append((os.fstat(handle).st_ino, os.fstat(handle).st_size))

    with Session(path, arc_welder, plan, clock=Ticks()) as session:
        monkeypatch.setattr(os, "fsync", noted)
        touch(session, "a")

    files = [(file.stat().st_ino, file.stat().st_size) for file in (journal_path(path), path)]
    assert len(synced) == 4  # intent, latch, result; the row
    assert synced[-2:] == files


def test_killed_at_any_byte_no_touch_is_lost_and_none_is_doubled(tmp_path: Path, arc_welder: Cell, plan: Plan) -> None:
    path, journal = tmp_path / "touches.csv", journal_path(tmp_path / "touches.csv")
    clock = Ticks()
    states = []  # what is on the disk after each completed write: a kill leaves something between two of them
    original = Journal.append

    def spied(self: Journal, record: dict[str, object]) -> None:
        before = journal.read_bytes(), path.read_bytes() if path.exists() else None
        original(self, record)
        states.append((before, (journal.read_bytes(), before[1])))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Journal, "append", spied)
        with Session(path, arc_welder, plan, clock=clock) as session:
            touch(session, "a")
            touch(session, "b")
    whole = journal.read_bytes(), path.read_bytes()

    for (journal_before, table_before), (journal_after, _) in [*states, (whole, whole)]:
        for cut in range(len(journal_before), len(journal_after) + 1, 23):
            check_resumed(path, arc_welder, plan, journal_after[:cut], table_before)
    for cut in range(0, len(whole[1]) + 1, 13):  # the table is written after its result: cut while the journal is whole
        check_resumed(path, arc_welder, plan, whole[0], whole[1][:cut])


def check_resumed(path: Path, cell: Cell, plan: Plan, journal: bytes, table: bytes | None) -> None:
    journal_path(path).write_bytes(journal)
    path.unlink(missing_ok=True)
    if table is not None:
        path.write_bytes(table)
    known = [line["line"] for line in map(record_of, journal.split(b"\n")[:-1]) if line and line["kind"] == "result"]

    with Session(path, cell, plan, resume=True, clock=Ticks()) as session:
        assert [row.split(",")[0] for row in known] == list(session.results)
        assert rows(path)[: len(known)] == known
        finish_all(session)

    assert names(path) == ["a", "b", "c"]
    assert rebuilt(journal_path(path)) == path.read_text()
    assert not path.with_name(BACKUP).exists()


def test_an_earlier_session_is_not_gone_on_with_by_accident(tmp_path: Path, arc_welder: Cell, plan: Plan) -> None:
    path = tmp_path / "touches.csv"
    with Session(path, arc_welder, plan) as session:
        touch(session, "a")

    with pytest.raises(InputError, match="go on with --resume"):
        Session(path, arc_welder, plan)


def test_another_plan_on_the_same_session_is_refused(tmp_path: Path, arc_welder: Cell, plan: Plan) -> None:
    path = tmp_path / "touches.csv"
    with Session(path, arc_welder, plan) as session:
        touch(session, "a")
    other = replace(plan, q=plan.q + 1e-6)

    with pytest.raises(InputError, match="another plan"):
        Session(path, arc_welder, other, resume=True)
    Session(path, arc_welder, plan, resume=True).close()


def test_a_run_that_ended_before_the_robot_went_anywhere_binds_nobody(
    tmp_path: Path, arc_welder: Cell, plan: Plan
) -> None:
    path, here = tmp_path / "touches.csv", plan.approach[0]
    with Session(path, arc_welder, plan) as session:
        session.trusted("B00T")
        session.intend(Intent("move", "", "B00T", 1, here, here, here, 0.1))

    with Session(path, arc_welder, replace(plan, q=plan.q + 0.1)) as session:
        assert (session.boot, session.intent) == ("", None)
