"""What is no URDF is said so."""

import pytest
from urdf_stages import mistakes

from identify.model.files import InputError
from identify.model.urdf.chain import read_urdf


@pytest.mark.parametrize(
    ("text", "line", "sentence"),
    [
        ("<robot>\n<link name='a'>\n</robot>", 3, "not well-formed XML: mismatched tag"),
        ("", 1, "not well-formed XML: no element found"),
        ("<robot>\n<link name='a'/>\n", 3, "not well-formed XML: no element found"),
        ("joints: []\n", 1, "not well-formed XML"),
        ("<sdf>\n<model/></sdf>", 1, "the outermost element is <sdf>, expected <robot>"),
        ("<robot/>", 0, "no link 'a' for the base; the file has no links"),
    ],
)
def test_what_is_no_urdf_is_said_so(folder, text, line, sentence):
    found = mistakes(folder, text)

    assert found[0][0] == line
    assert sentence in found[0][1]


def test_a_file_that_cannot_be_read_is_said_so(folder, tmp_path):
    (tmp_path / "binary.urdf").write_bytes(b"\xff\xfe\x00\x01")

    with pytest.raises(InputError, match="no such file"):
        read_urdf(tmp_path / "missing.urdf", "a", "b")
    with pytest.raises(InputError, match="not a text file"):
        read_urdf(tmp_path / "binary.urdf", "a", "b")
