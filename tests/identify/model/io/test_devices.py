"""`measure:` of the cell: what is left out is as usual, what is wrong is named with its line."""

import numpy as np
import pytest

from identify.model.cell import DEVICES
from identify.model.files import InputError
from identify.model.io.description import library, read_cell
from identify.model.io.entries import cell_entry, cell_from_entry


def cell_with(tmp_path, text):
    file = tmp_path / "cell.yaml"
    file.write_text(library("cells")["arc-welder"].read_text() + text)
    return file


def test_what_a_device_does_not_say_is_as_usual_for_its_kind(tmp_path):
    cell = read_cell(
        cell_with(tmp_path, "measure: {distance: {sigma_mm: 0.02}, position: {box_mm: [[0, 1], [2, 3], [4, 5]]}}\n")
    )

    assert cell.device("distance").sigma == 0.02
    assert cell.device("distance").minutes == DEVICES["distance"].minutes
    assert cell.sigma("contact") == cell.touch.sigma
    np.testing.assert_array_equal(cell.device("position").box, [[0, 1], [2, 3], [4, 5]])


def test_a_tracker_says_where_it_stands_and_what_it_sees(tmp_path):
    words = "stand_mm: [0, -2500, 300], range_mm: [800, 9000], azimuth_deg: [30, 150], target_axis: [0, 0, 1]"
    cell = read_cell(cell_with(tmp_path, f"measure: {{pose: {{{words}}}}}\n"))

    for device in (cell.device("pose"), cell_from_entry(cell_entry(cell), {}).device("pose")):
        np.testing.assert_array_equal(device.stand, [0, -2500, 300])
        np.testing.assert_array_equal(device.target_axis, [0, 0, 1])
        assert device.range == (800, 9000)
        assert device.azimuth == pytest.approx(np.radians([30, 150]))
        assert device.elevation == pytest.approx(DEVICES["pose"].elevation)


def test_devices_survive_in_a_calibration(tmp_path):
    cell = read_cell(
        cell_with(tmp_path, "measure: {pose: {sigma_deg: 0.1, minutes: 2}, distance: {range_mm: [400, 400]}}\n")
    )

    again = cell_from_entry(cell_entry(cell), {})

    assert again.device("pose").turn_sigma == pytest.approx(np.radians(0.1))
    assert again.device("pose").minutes == 2
    assert again.device("distance").range == (400, 400)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("measure: {distance: {range_mm: [900, 300]}}", "write the smaller number first"),
        ("measure: {position: {box_mm: [[0, 1], [3, 2], [4, 5]]}}", "write the smaller number first"),
        ("measure: {touch: {sigma_mm: 0.1}}", "sigma_mm under touch:"),
        ("measure: {distance: {stand_mm: [0, 0, 0]}}", "stand_mm is of a tracker"),
        ("measure: {pose: {azimuth_deg: [-20, 20]}}", "add stand_mm"),
        ("measure: {pose: {stand_mm: [0, 0, 0], target_axis: [0, 0, 0]}}", "target_axis has length 0"),
        ("measure: {pose: {stand_mm: [0, 0, 0], elevation_deg: [20, -20]}}", "write the smaller number first"),
        ("measure: {distnce: {minutes: 1}}", "distnce"),
        ("measure: {distance: {minutes: 0}}", "minutes"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path, text, words):
    with pytest.raises(InputError, match=words) as error:
        read_cell(cell_with(tmp_path, text + "\n"))

    assert "cell.yaml:" in str(error.value)
