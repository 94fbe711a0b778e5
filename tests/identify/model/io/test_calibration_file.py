"""calibration.json: what is no calibration is refused in one sentence, wherever it is broken."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from measured import poses_over_jig, table_2, touches_at

from identify.estimation.calibrate import calibrate
from identify.model.files import InputError
from identify.model.io.calibration_file import read_calibration, write_calibration


@pytest.fixture(scope="module")
def document(arc_welder, tmp_path_factory):
    """What calibration.json holds."""
    rng, path = np.random.default_rng(3), tmp_path_factory.mktemp("calibration") / "calibration.json"
    touches = touches_at(arc_welder, arc_welder.theta, poses_over_jig(arc_welder, 60, rng), rng)
    write_calibration(path, calibrate(arc_welder, touches, folds=0, errors="cell"))
    return json.loads(path.read_text())


def refused(document, folder):
    """What reading a document as calibration.json says, if it is refused; a sentence that names the file."""
    path = folder / "calibration.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    try:
        read_calibration(path)
    except InputError as error:
        said = str(error)
    else:
        said = ""
    assert not said or said.startswith(str(path))
    return said


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("fit", None, "not a calibration: fit: Input should be"),
        ("covariance", [], "its covariance is 0 x 0, expected 53 x 53, a row a parameter; make it again"),
        ("covariance", [[1.0], [1.0, 2.0]], "its covariance is 2 x 1 or 2, expected 53 x 53"),
        ("covariance", np.zeros((53, 53)).tolist(), "its covariance is not one: variances and covariances do not fit"),
        ("parameters", [], "its parameters are not those of its robot"),
        ("touchcal", 3, "not a calibration: touchcal: Input should be a valid string"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused_in_one_sentence(key, value, sentence, document, tmp_path):
    assert sentence in refused(document | {key: value}, tmp_path)


@pytest.mark.parametrize(("key", "value"), [("fixed", ["j9.theta"]), ("bounds", {"j9.theta": [0, 1]})])
def test_a_cell_in_a_calibration_that_names_what_its_robot_lacks_is_refused(key, value, document, tmp_path):
    said = refused(document | {"cell": document["cell"] | {key: value}}, tmp_path)

    assert "not a calibration: robot 'arc-welder' has no parameter 'j9.theta'; make it again" in said


@given(data=st.data())
def test_a_calibration_cut_short_or_spoiled_anywhere_is_read_or_refused(data, document, tmp_path_factory):
    folder = tmp_path_factory.mktemp("spoiled")
    text = json.dumps(document)

    assert refused(text[: data.draw(st.integers(0, len(text) - 1))], folder)
    refused(spoiled(copy.deepcopy(document), data.draw), folder)


def spoiled(document, draw):
    """A document one of whose values is gone or replaced."""
    place = document
    while True:
        key = draw(st.sampled_from(sorted(place) if isinstance(place, dict) else range(len(place))))
        if not isinstance(place[key], dict | list) or not place[key] or draw(st.integers(0, 3)) == 0:
            break
        place = place[key]
    if draw(st.booleans()):
        del place[key]
    else:
        place[key] = draw(st.sampled_from([None, [], {}, "", 0, -1, 1e308, 1e-320, True, "x", [[1]]]))
    return document


def test_faces_and_their_covariance_with_the_parameters_are_read_back(arc_welder, rng, tmp_path):
    q = poses_over_jig(arc_welder, 40, rng)
    touches = touches_at(arc_welder, table_2(arc_welder), q, rng)
    faces = tuple(list(arc_welder.jig.by_name)[i % 3] for i in range(40))
    found = calibrate(arc_welder, replace(touches, face=faces), folds=0, errors="cell")

    write_calibration(tmp_path / "c.json", found)
    again = read_calibration(tmp_path / "c.json")

    assert [s.name for s in again.shared] == [f"face.{face.name}" for face in arc_welder.jig.faces]
    np.testing.assert_allclose([s.value for s in again.shared], [s.value for s in found.shared], atol=1e-12)
    np.testing.assert_allclose(again.joint_covariance, found.joint_covariance, rtol=1e-9, atol=1e-15)
    assert again.discrepancy == found.discrepancy
    entry = json.loads((tmp_path / "c.json").read_text())
    assert {face["name"]: face["offset_mm"] for face in entry["faces"]} == pytest.approx(
        {shared.name.removeprefix("face."): shared.value for shared in found.shared}
    )


def test_a_file_that_a_hand_changed_is_refused_with_the_key_until_its_checksums_go(document, found, tmp_path):
    path = tmp_path / "calibration.json"
    write_calibration(path, found)
    written = json.loads(path.read_text())
    written["parameters"][0]["value"] += 1.0

    said = refused(written, tmp_path)

    assert "parameters changed since touchcal wrote the file" in said
    assert refused({key: value for key, value in written.items() if key != "checksums"}, tmp_path) == ""
    assert refused(json.loads(path.read_text()), tmp_path) == ""


def test_a_file_of_the_first_version_is_read(document, found, tmp_path):
    newer = {"format", "faces", "shared", "discrepancy", "promise", "checksums"}
    path = tmp_path / "first.json"
    write_calibration(path, found)
    first = {key: value for key, value in json.loads(path.read_text()).items() if key not in newer}
    path.write_text(json.dumps(first))

    again = read_calibration(path)

    assert again.discrepancy is None
    assert again.shared == ()
    np.testing.assert_allclose(again.covariance, found.covariance, rtol=1e-9)
    assert again.noise == max(1.0, found.scatter if found.scatter_significant else 1.0)
