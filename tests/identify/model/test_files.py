"""Files are read whatever wrote them, and written whole or not at all; what is no table is said so."""

from pathlib import Path

import numpy as np
import pytest
from sheets import POSITIONS, TOUCHES, change, mistakes

from identify.model.files import InputError, write_text
from identify.model.io.tables import read_plan, read_positions, read_touches


def test_a_long_list_of_mistakes_is_cut_and_says_so(write, arc_welder):
    rows = "".join(f"t{i},top-low,a,b,c,d,e,f\n" for i in range(10))

    with pytest.raises(InputError) as caught:
        read_touches(write("id,face,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n" + rows), arc_welder)

    assert len(caught.value.mistakes) == 60
    assert str(caught.value).endswith("\n... and 40 more")


@pytest.mark.parametrize("read", [read_touches, read_positions, read_plan])
@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "0: the file is empty, expected a header line and rows"),
        (b"\n\n  \n", "0: the file is empty"),
        (b"\xef\xbb\xbf", "0: the file is empty"),
        (b"PK\x03\x04\xff\xfe\x00", "0: not a text file in UTF-8 (byte 4); save it as UTF-8"),
        (b"id;q1_deg;q2_deg\nt1;1,5;2\n", "1: columns are parted by semicolons or tabs; save the file with commas"),
        (b"id\tq1_deg\nt1\t1\n", "1: columns are parted by semicolons or tabs"),
        (b"\x00\x00\x00\n", "1: column 'id' is missing"),
        (b"1,2,3\n4,5,6\n", "1: column 'id' is missing"),
        (b'{"parameters": []}\n', "0: this is JSON, expected a table of commas"),
        (b"<robot/>\n", "0: this is XML, expected a table of commas"),
    ],
)
def test_what_is_no_table_is_said_so(write, arc_welder, read, content, sentence):
    assert any(line.startswith(sentence) for line in mistakes(write(content), arc_welder, read))


@pytest.mark.parametrize("read", [read_touches, read_positions, read_plan])
def test_a_missing_file_is_said_so(tmp_path, arc_welder, read):
    assert mistakes(tmp_path / "none.csv", arc_welder, read) == ["0: no such file; check the name and the folder"]
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path, arc_welder)


def test_a_quotation_mark_left_open_is_said_so(write, arc_welder):
    text = change(TOUCHES, '"a note', '"' + "a note" * 30_000)

    found = mistakes(write(text.replace('comma"', "comma")), arc_welder)

    assert any("is a quotation mark left open?" in line for line in found)
    assert any("left open?" in line for line in mistakes(write('"' + POSITIONS * 1000), arc_welder))


def test_files_of_windows_and_of_spreadsheets_are_read(write, arc_welder):
    plain = read_touches(write(TOUCHES), arc_welder)
    spreadsheet = "".join(line + ",,\n" for line in TOUCHES.splitlines()) + ",,,,\n\n"
    variants = [
        b"\xef\xbb\xbf" + TOUCHES.encode(),
        TOUCHES.replace("\n", "\r\n").encode(),
        TOUCHES.replace(",", " , ").replace("note ,", "note,").replace(",  with", ", with").encode(),
        spreadsheet.encode(),
    ]

    for content in variants:
        touches = read_touches(write(content), arc_welder)

        np.testing.assert_array_equal(touches.q, plain.q)
        np.testing.assert_array_equal(touches.sigma, plain.sigma)
        assert (touches.ids, touches.face, touches.note) == (plain.ids, plain.face, plain.note)


def test_a_mistake_keeps_its_line_behind_line_ends_of_windows_and_blank_lines(write, arc_welder):
    text = change(TOUCHES, "12,-22", "12,x").replace("\n", "\r\n").replace("t3,", "\r\n\r\nt3,")

    assert mistakes(write(text), arc_welder)[0].startswith("7: q2_deg is 'x'")


def test_unknown_columns_warn_and_are_ignored(write, arc_welder):
    path = write(change(TOUCHES, "temperature_c,note", "temp,note"))

    with pytest.warns(UserWarning, match="unknown column 'temp' ignored"):
        touches = read_touches(path, arc_welder)

    assert np.isnan(touches.temperature).all()


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "plan.csv"
    write_text(path, "old\n")

    def fails(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fails)
    with pytest.raises(InputError, match="cannot be written: No space left on device; choose another place with -o"):
        write_text(path, "new\n")

    assert path.read_text() == "old\n"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match="cannot be written"):
        write_text(tmp_path / "none" / "plan.csv", "new\n")
