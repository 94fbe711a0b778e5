"""What is no document of ours is said so; files of Windows are read."""

import pytest
from cell_texts import mistakes

from identify.model.io.description import read_cell


@pytest.mark.parametrize(
    ("content", "line", "sentence"),
    [
        (b"", 1, "expected keys such as robot, jig, base"),
        (b"# nothing but a comment\n", 1, "expected keys such as robot, jig, base"),
        (b"- robot\n- jig\n", 1, "expected keys such as"),
        (b"just words\n", 1, "expected keys such as"),
        (b"robot: \xff\xfe\n", 0, "not a text file in UTF-8 (byte 7); save it as UTF-8"),
        (b"\x00\x01\x02\x03", 1, "not valid YAML: "),
        (b"robot: a\x07b\n", 1, "not valid YAML: "),
        (b"a: &x [*x]\n", 1, "unknown key 'a'"),
        (b"robot: !!python/object:os.system ls\n", 1, ""),
        (b"--- \nrobot: a\n---\nrobot: b\n", 3, "not valid YAML: "),
        (b"robot: 2001-13-45\n", 0, "not valid YAML: month must be in 1..12"),
        (b"[" * 1000, 0, "brackets stand more than 50 deep; close them"),
        (b"tool: {x_mm: 12,5, y_mm: 0}\n", 1, "12,5 has a decimal comma; write 12.5"),
        (b"zone:\n  max_tilt_deg: -0,5  # half\n", 2, "-0,5 has a decimal comma; write -0.5"),
        (b'temperature_c: "21,5"\n', 1, "temperature_c: 21,5 has a decimal comma; write 21.5"),
        (b"1: 2\n", 1, ""),
        (b"? [a, b]\n: 2\n", 1, ""),
    ],
)
def test_what_is_no_cell_file_is_said_so(tmp_path, content, line, sentence):
    (tmp_path / "cell.yaml").write_bytes(content)

    found = mistakes(tmp_path / "cell.yaml")

    assert any(text.startswith(f"cell.yaml:{line}: {sentence}") for text in found), found


def test_a_missing_cell_file_is_said_so(tmp_path):
    assert mistakes(tmp_path / "cell.yaml") == ["cell.yaml:0: no such file; check the name and the folder"]


def test_byte_order_mark_and_line_ends_of_windows_are_read(write_cell):
    path = write_cell()
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))

    assert read_cell(path).bounds == {"j2.a": (340, 360)}
    path.write_bytes(path.read_bytes().replace(b"z_mm: 410", b"z_mm: x"))
    assert mistakes(path)[0].startswith("cell.yaml:5: tool.z_mm is 'x'")
