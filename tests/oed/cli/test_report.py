"""`touchcal report`: the page, with the touches beside it."""

import json

import numpy as np

UNSEEN = [("unseen.csv",), ("--unseen", "unseen.csv")]


def test_a_calibration_is_reported_with_the_touches_beside_it(planned, touchcal, arc_welder):
    from measured import poses_over_jig, table_2, touches_at

    from identify.model.io.tables import touches_text

    rng = np.random.default_rng(3)
    touches = touches_at(arc_welder, table_2(arc_welder), poses_over_jig(arc_welder, 60, rng), rng)
    (planned / "touches.csv").write_text(touches_text(touches, arc_welder.robot))
    touchcal("identify", "touches.csv")

    code, _, err = touchcal("report", "calibration.json")

    assert code == 0, err
    page = (planned / "report.html").read_text()
    assert '"id": "t60"' in page
    assert json.loads((planned / "report.json").read_text())["inputs"].keys() == {"touches.csv"}


def test_unseen_files_are_named_as_for_verify(folder, touchcal):
    touchcal("identify", "touches.csv")
    told = [touchcal("report", "calibration.json", *words, "-o", f"{len(words)}.html") for words in UNSEEN]

    assert [code for code, *_ in told] == [0, 0]
    assert (folder / "1.html").read_text() == (folder / "2.html").read_text()
    verified = json.loads(touchcal("verify", "calibration.json", "unseen.csv", "--json")[1])
    assert f"{verified['p95_mm']:.3f}" in (folder / "1.html").read_text()
