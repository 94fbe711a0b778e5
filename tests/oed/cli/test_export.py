"""`touchcal export` as a user meets it: files of every format, and what a format costs."""

import json

import pytest
from identified import identified

from identify.model.io.calibration_file import write_calibration


@pytest.mark.parametrize("format", ["urdf", "ur-yaml", "dh-csv", "json", "mastering-text"])
def test_export_writes_files_and_says_what_the_format_costs(format, project, touchcal):
    code, out, _ = touchcal("export", "calibration.json", "--format", format)
    told = json.loads(touchcal("export", "calibration.json", "--format", format, "-o", "other.x", "--json")[1])

    assert code == 0
    assert "read again, the tip is at most this far from the identified robot's" in out
    assert told["files"][0] == "other.x"
    assert all((project / name).read_text() for name in told["files"])
    assert (told["deviation"]["max_mm"] < 1e-6) == (format != "mastering-text")


def test_export_corrects_the_urdf_that_it_wrote_itself_for_the_nominal_robot(project, touchcal, arc_welder):
    write_calibration(project / "nominal.json", identified(arc_welder, arc_welder.theta))
    touchcal("export", "nominal.json", "--format", "urdf", "-o", "arm.urdf")
    text = (project / "arm.urdf").read_text().replace("touchcal_", "drawn_")
    (project / "arm.urdf").write_text(text)

    code, out, _ = touchcal(
        "export",
        "calibration.json",
        "--format",
        "urdf",
        "--urdf",
        "arm.urdf",
        "--base",
        "base_link",
        "--flange",
        "flange",
    )

    assert code == 0
    assert "identified robot's: nothing" in out
    assert 'name="drawn_tip"' in (project / "calibrated.urdf").read_text()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["export", "calibration.json", "--format", "sdf"], "sdf"),
        (["export", "calibration.json", "--format", "urdf", "--urdf", "none.urdf"], "name the links of the chain"),
        (
            ["export", "calibration.json", "--format", "urdf", "--urdf", "none.urdf", "--base", "a", "--flange", "b"],
            "none.urdf: no such file",
        ),
    ],
)
def test_bad_input_gets_one_sentence_and_exit_code_2(arguments, sentence, project, touchcal):
    before = sorted(project.rglob("*"))

    code, out, err = touchcal(*arguments)

    assert (code, out) == (2, "")
    assert sentence in err
    assert "Traceback" not in err
    assert sorted(project.rglob("*")) == before
