"""What is written into one document comes back the same."""

import numpy as np
import pytest
from cell_texts import CELL, change

from identify.model.io.description import library, read_cell
from identify.model.io.entries import cell_entry, cell_from_entry


@pytest.mark.parametrize("name", library("cells"))
def test_a_cell_written_into_one_document_comes_back_the_same(name):
    cell = read_cell(library("cells")[name])

    again = cell_from_entry(cell_entry(cell), dict(cell.sources))

    np.testing.assert_allclose(again.theta, cell.theta, rtol=1e-14)
    np.testing.assert_allclose(again.prior, cell.prior, rtol=1e-14)
    assert again.robot.joints[0].name == cell.robot.joints[0].name
    assert [face.name for face in again.jig.faces] == [face.name for face in cell.jig.faces]
    assert cell_entry(again)["zone"] == cell_entry(cell)["zone"]


def test_the_ends_of_a_urdf_survive_being_written_into_one_document(write_cell, tmp_path):
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><joint name="a" type="continuous"><parent link="p"/><child link="c"/>'
        '<origin xyz="0.1 0.2 0.5" rpy="0.1 1.5707963 0.3"/><axis xyz="1 2 3"/></joint>'
        '<joint name="b" type="fixed"><parent link="c"/><child link="d"/><origin rpy="1 2 3" xyz="0 0.1 0"/></joint>'
        "</robot>"
    )
    text = change(CELL, "robot: robot.yaml", "robot: {urdf: arm.urdf, base: p, flange: d}").replace("j2.a: ", "a.a: ")
    text = text.replace("j1.beta", "a.beta")
    cell = read_cell(write_cell(text))

    again = cell_from_entry(cell_entry(cell), {})

    np.testing.assert_allclose(again.robot.base_T_first, cell.robot.base_T_first, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(again.robot.last_T_flange, cell.robot.last_T_flange, rtol=1e-12, atol=1e-12)
