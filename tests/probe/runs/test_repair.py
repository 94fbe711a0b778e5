"""Rows that the journal does not know: adopted where they can be believed."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sessions import finish_all, names, rebuilt, small_plan

from identify.model.cell import Cell
from identify.model.files import InputError
from identify.model.io.tables import joint_columns
from identify.model.touch import Plan
from probe.runs.repair import row_objection
from probe.runs.session import Session, journal_path

BACKUP = "touches.csv.bak"

pytestmark = pytest.mark.usefixtures("unsynced")


@pytest.fixture(scope="module")
def plan() -> Plan:
    return small_plan()


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


def test_touches_that_no_journal_knows_are_not_written_over(tmp_path: Path, arc_welder: Cell, plan: Plan) -> None:
    path = tmp_path / "touches.csv"
    text = ",".join(["id", *joint_columns(arc_welder.robot)]) + "\nx,1,2,3,4,5,6\n"
    path.write_text(text)

    with pytest.raises(InputError, match="holds touches but has no journal"):
        Session(path, arc_welder, plan)

    assert path.read_text() == text


def test_a_row_with_a_character_that_cannot_be_printed_is_no_touch(arc_welder: Cell, plan: Plan) -> None:
    """The defect: a carriage return in a row ended `--resume` with a traceback of the reader of CSV."""
    assert "cannot be printed" in row_objection("a,top\r,hit", arc_welder, plan)
