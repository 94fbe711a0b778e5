"""Of the text of a URDF only the origins of its chain change."""

import re

from exported import FLANGE, from_urdf
from identified import identified

from identify.export.exporting import export
from identify.export.formats import Original


def test_everything_but_origins_of_the_chain_is_kept(tmp_path, rng):
    path, calibration = from_urdf(tmp_path, FLANGE, "base_link", "tool0", rng)

    text = export(calibration, "urdf", Original(path, "base_link", "tool0")).files[".urdf"]

    def skeleton(whole):
        added = re.compile(
            r'  <link name="touchcal_(\w+)"/>\n  <joint name="touchcal_\1_joint".*?</joint>\n', re.DOTALL
        )
        return re.sub(r"""(<origin\b[^>]*)/>""", "", added.sub("", whole))

    kept = ['<origin xyz="9 9 9"/> in a comment', '<origin xyz="0 0 1"/></joint>', '<origin rpy="0 1 0"/>']
    kept += ['<origin xyz="0 0 0.1" rpy="0 0 0"/>', '<origin xyz="0 0.02 0.1" rpy="0.1 0 0.2"/>']
    assert skeleton(text) == skeleton(path.read_text())
    assert all(part in text for part in kept)
    assert re.search(r'<joint name="a2" type="revolute"><origin xyz="[^"]+" rpy="[^"]+"/><parent', text)  # it had none


def test_a_robot_as_nominal_keeps_every_byte_and_gets_two_links(tmp_path, rng):
    path, calibration = from_urdf(tmp_path, FLANGE, "base_link", "tool0", rng)
    as_drawn = identified(calibration.cell, calibration.cell.theta)

    text = export(as_drawn, "urdf", Original(path, "base_link", "tool0")).files[".urdf"]

    head, tail = path.read_text().split("</robot>")
    assert text.startswith(head)
    assert text.endswith("</robot>" + tail)
