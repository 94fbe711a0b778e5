"""`joints:` of a cell: what it says, and what is wrong with it."""

import pytest
from counts import ODD, cell_text

from identify.model.files import InputError
from identify.model.io.description import read_cell
from identify.model.io.entries import cell_entry, cell_from_entry


def test_a_cell_says_how_its_controller_counts(counted):
    assert counted.robot.counting == ODD


def test_a_calibration_remembers_how_the_controller_counts(counted):
    again = cell_from_entry(cell_entry(counted), {})

    assert again.robot.counting == ODD


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("joints: {sign: {j9: -1}}", "joints.sign names a joint that the robot does not have: 'j9'"),
        ("joints: {sign: [1, -1]}", "joints.sign has 2 numbers, the robot has 6 joints"),
        ("joints: {sign: [1, 1, 2, 1, 1, 1]}", "joints.sign.2 is 2"),
        ("joints: {coupled: {j3: j8}}", "joints.coupled: the robot has no joint 'j8'"),
        ("joints: {coupled: {j3: j2, j2: -j3}}", "the couplings run in a circle"),
        ("joints: {pulses_per_deg: {j1: 100}}", "no number for j2, j3, j4, j5, j6"),
        ("joints: {zero: [0]}", "unknown key 'joints.zero'; did you mean 'zero_deg'"),
    ],
)
def test_a_mistake_in_joints_is_told_with_its_line(line, sentence, tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(cell_text(line))
    where = path.read_text().splitlines().index(line) + 1

    with pytest.raises(InputError) as error:
        read_cell(path)

    assert sentence in str(error.value)
    assert f"cell.yaml:{where}: " in str(error.value)
