"""What `touchcal campaign` says of its stages and of its end."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from identify.model.io.description import library
from oed.cli.campaign import line, story, summary


def stage(number, promised, outliers=()):
    """A stage of four touches, three of which met the jig."""
    calibration = SimpleNamespace(scatter=1.25, outliers=dict.fromkeys(outliers, 1.0))
    job = SimpleNamespace(number=number, deviation=1.5, cell=SimpleNamespace(touch=SimpleNamespace(approach=20.0)))
    return SimpleNamespace(job=job, calibration=calibration, hits=3, touches=range(4), promised_mm=promised)


@pytest.fixture
def result():
    stages = (stage(1, None), stage(2, 0.125, ["t7"]))
    return SimpleNamespace(
        stages=stages, touches=8, target_mm=0.2, promised_mm=0.125, reached=True, why="the promise is kept"
    )


def test_a_stage_tells_its_touches_and_its_promise_and_what_was_left_out(result):
    assert [line(each) for each in result.stages] == [
        "stage 1: tip within 3 mm before, 3 of 4 touches met the jig; too few to identify the robot",
        "stage 2: tip within 3 mm before, 3 of 4 touches met the jig, 1 left out; "
        "promised 95 % 0.125 mm, scatter 1.25 sigma",
    ]


def test_the_summary_counts_over_the_stages(result):
    said = summary(result)

    assert (said["touches"], said["hits"], said["promised_p95_mm"], said["reached"]) == (8, 6, 0.125, True)
    assert [each["outliers"] for each in said["stages"]] == [[], ["t7"]]


def test_an_end_that_is_not_the_target_says_so(result):
    result.reached = False

    assert story(result, Path("work")).startswith("NOT reached after 8 touches: the promise is kept\nwrote work/")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [(["--target", "-1"], "target"), (["--max-touches", "0"], "touches"), (["--cell", "none.yaml"], "none.yaml")],
)
def test_bad_input_gets_one_sentence_and_no_folder(options, sentence, touchcal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cell.yaml").write_text(library("cells")["arc-welder"].read_text())

    code, out, err = touchcal("campaign", *options)

    assert (code, out) == (2, "")
    assert sentence in err
    assert [path.name for path in tmp_path.iterdir()] == ["cell.yaml"]
