"""The journal cut at every byte or damaged: whole records are kept, the others named."""

import json
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from probe.runs.journal import Journal, line_of, read_records, record_of

pytestmark = pytest.mark.usefixtures("unsynced")


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
