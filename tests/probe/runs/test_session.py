"""The journal and touches.csv: cut at every byte, damaged, edited, locked; no touch is lost, none is doubled."""

import json
import os
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from touching import Ticks

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.tables import joint_columns, read_touches, touch_columns
from identify.model.touch import Plan
from probe.line.controller import Contact
from probe.runs.journal import Journal, line_of, read_records, record_of
from probe.runs.records import Intent, Reading, Result
from probe.runs.session import Session, journal_path, rebuilt

pytestmark = pytest.mark.usefixtures("unsynced")
BACKUP = "touches.csv.bak"


@pytest.fixture(scope="module")
def plan(arc_welder: Cell) -> Plan:
    return small_plan()


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


@given(st.dictionaries(st.text(max_size=5), st.integers() | st.text(max_size=9) | st.lists(st.floats(-9, 9))))
def test_a_record_comes_back_from_its_line_as_it_was(record: dict[str, object]) -> None:
    line = line_of(record)

    assert line.endswith(b"\n")
    assert line.count(b"\n") == 1
    back = record_of(line[:-1])
    assert back is not None
    assert {key: back[key] for key in back if key != "crc" or key in record} == record


def test_a_record_is_plain_json_with_the_published_crc() -> None:
    line = line_of({"kind": "boot", "boot": "A1"}).decode()

    before = b'{"kind": "boot", "boot": "A1"'
    assert json.loads(line)["crc"] == f"{zlib.crc32(before):08x}"


def test_a_journal_cut_at_any_byte_keeps_its_whole_records_and_goes_on(tmp_path: Path) -> None:
    records = [{"n": i, "text": "x" * i} for i in range(5)]
    lines = [line_of(record) for record in records]
    whole = b"".join(lines)
    path = tmp_path / "j"

    for cut in range(len(whole) + 1):
        path.write_bytes(whole[:cut])
        kept = sum(len(b"".join(lines[: i + 1])) <= cut for i in range(5))
        journal = Journal(path)
        assert [record["n"] for record in journal.records] == list(range(kept))
        journal.append({"n": 99})
        journal.close()
        assert [record["n"] for record in read_records(path).records] == [*range(kept), 99]


def test_a_journal_damaged_in_its_middle_keeps_what_is_whole_and_names_what_is_not(tmp_path: Path) -> None:
    path = tmp_path / "j"
    lines = [line_of({"number": i, "text": "x"}) for i in range(6)]
    damaged = lines[0] + lines[1].replace(b"x", b"y") + lines[2] + lines[2] + lines[5]
    path.write_bytes(damaged)

    journal = Journal(path)

    assert [record["text"] for record in journal.records] == ["x"] * 3
    assert journal.broken == ["line 2 is damaged", "line 4 repeats record 2", "before line 5, 2 records are missing"]
    assert (tmp_path / journal.copy).read_bytes() == damaged
    journal.append({"text": "z"})
    journal.close()
    again = Journal(path)
    assert (again.broken, [record["number"] for record in again.records]) == ([], [0, 1, 2, 3])
    again.close()


@given(data=st.data())
def test_a_session_opens_whatever_happened_to_its_files(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory, arc_welder: Cell
) -> None:
    """The defect: a truncated journal and a flipped byte of touches.csv together made a session unusable."""
    folder = tmp_path_factory.mktemp("session")
    path, journal = folder / "touches.csv", journal_path(folder / "touches.csv")
    plan = small_plan()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda handle: None)
        with Session(path, arc_welder, plan) as session:
            finish_all(session)
        table = path.read_text().splitlines()
        for file in (path, journal):
            content = bytearray(file.read_bytes())
            kind = data.draw(st.sampled_from(["whole", "cut", "flip", "double", "empty", "foreign"]))
            at = data.draw(st.integers(0, len(content) - 1))
            if kind == "flip":
                content[at] ^= 1 << data.draw(st.integers(0, 7))
            foreign = b"\xff\x00\nx,y\n" + content
            damaged = {"cut": content[:at], "double": content + content[at:], "empty": b"", "foreign": foreign}
            changed = damaged.get(kind, content)
            file.write_bytes(bytes(changed))

        with Session(path, arc_welder, plan, resume=True) as session:
            rows = path.read_text().splitlines()
            assert rows[0] == table[0]
            assert set(session.results) == {row.split(",")[0] for row in rows[1:]}
            for result in session.results.values():  # no row is adopted with other joints, but for its last digits
                np.testing.assert_allclose(result.reading.q, plan.q[plan.ids.index(result.id)], atol=4e-4)
            finish_all(session)
        assert sorted(names(path)) == ["a", "b", "c"]


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


def test_a_journal_that_lost_its_end_takes_whole_rows_back_from_the_table(
    tmp_path: Path, arc_welder: Cell, plan: Plan
) -> None:
    path, journal = tmp_path / "touches.csv", journal_path(tmp_path / "touches.csv")
    with Session(path, arc_welder, plan) as session:
        finish_all(session)
    whole, table = journal.read_bytes(), path.read_bytes()
    birth = whole.index(b"\n") + 1

    for cut in range(birth, len(whole), 23):
        journal.write_bytes(whole[:cut])
        path.write_bytes(table)
        with Session(path, arc_welder, plan, resume=True) as session:
            assert list(session.results) == ["a", "b", "c"]
        assert path.read_bytes() == table
        assert rebuilt(journal) == table.decode()


def test_an_edited_table_is_written_anew_and_the_edited_one_is_kept(
    tmp_path: Path, arc_welder: Cell, plan: Plan
) -> None:
    path = tmp_path / "touches.csv"
    with Session(path, arc_welder, plan) as session:
        finish_all(session)
    right = path.read_text()
    path.write_text(right.replace("hit", "miss", 1))

    with Session(path, arc_welder, plan, resume=True) as session:
        assert "written anew" in session.repaired

    assert path.read_text() == right
    assert "miss" in path.with_name(BACKUP).read_text()


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


def test_touches_that_no_journal_knows_are_not_written_over(tmp_path: Path, arc_welder: Cell, plan: Plan) -> None:
    path = tmp_path / "touches.csv"
    text = ",".join(["id", *joint_columns(arc_welder.robot)]) + "\nx,1,2,3,4,5,6\n"
    path.write_text(text)

    with pytest.raises(InputError, match="holds touches but has no journal"):
        Session(path, arc_welder, plan)

    assert path.read_text() == text


def test_a_second_program_on_the_same_session_is_refused_until_the_first_is_dead(
    tmp_path: Path, arc_welder: Cell, plan: Plan
) -> None:
    path = tmp_path / "touches.csv"
    held = f"from probe.runs.lock import Lock; from pathlib import Path; Lock(Path({str(path.with_suffix('.lock'))!r}))"
    command = [sys.executable, "-c", f"{held}; print('held', flush=True); import time; time.sleep(60)"]

    with subprocess.Popen(command, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(InputError, match="another program works on this session"):
            Session(path, arc_welder, plan)
        other.kill()
        other.wait()

    Session(path, arc_welder, plan).close()


def test_a_folder_that_is_not_there_gets_one_sentence(tmp_path: Path, arc_welder: Cell, plan: Plan) -> None:
    with pytest.raises(InputError, match="choose another folder"):
        Session(tmp_path / "none" / "touches.csv", arc_welder, plan)
