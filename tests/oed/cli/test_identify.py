"""The command line as a user meets it: what it says, what it writes, what it answers to bad input."""

import json
import subprocess
import sys

import numpy as np
import pytest
from measured import poses_over_jig, positions_at, table_2, touches_at, with_offsets

from identify.model.frames import rotation
from identify.model.io.tables import positions_text, touches_text

SIGMA = 0.05  # [mm]


def edit(path, change):
    """Change the lines of a file."""
    lines = path.read_text().splitlines()
    change(lines)
    path.write_text("\n".join(lines) + "\n")


def test_identify_and_verify_run_through(folder, touchcal):
    code, out, _ = touchcal("identify", "touches.csv")
    assert (code, "107 of 107 parameters" in out) == (0, True)

    code, out, _ = touchcal("verify", "calibration.json", "unseen.csv")
    assert (code, "identified robot, unseen" in out) == (0, True)


@pytest.fixture
def far_off(folder, arc_welder):
    """Touches and unseen positions of a robot off by its tolerances, axes not parallel, in place of the paper's."""
    rng = np.random.default_rng(2)
    truth = arc_welder.theta + arc_welder.prior * rng.standard_normal(len(arc_welder.theta))
    q = poses_over_jig(arc_welder, 160, rng)
    touches, unseen = touches_at(arc_welder, truth, q[:100], rng, SIGMA), positions_at(arc_welder, truth, q[100:], rng)
    (folder / "touches.csv").write_text(touches_text(touches, arc_welder.robot))
    (folder / "unseen.csv").write_text(positions_text(unseen, arc_welder.robot))
    return folder


def test_all_parameters_are_estimated_on_demand_and_a_robot_far_off_its_drawing_gains_by_it(far_off, touchcal):
    off = {}
    for which in ("identifiable", "all"):
        touchcal("identify", "touches.csv", "--parameters", which, "-o", f"{which}.json")
        off[which] = json.loads(touchcal("verify", f"{which}.json", "unseen.csv", "--json")[1])

    assert off["identifiable"]["rms_mm"] > 1.5 * off["all"]["rms_mm"]
    assert off["all"]["p95_mm"] < off["all"]["promised_p95_mm"]


def test_what_all_parameters_came_to_is_told_reported_and_used(far_off, touchcal, arc_welder):
    code, out, _ = touchcal("identify", "touches.csv", "--parameters", "all")
    assert (code, "107 of 107 parameters estimated" in out, "eliminated:" in out) == (0, True, False)
    (far_off / "poses.csv").write_text("id,x_mm,y_mm,z_mm,rz_deg,ry_deg,rx_deg\nstart,120,150,210,-90,0,180\n")

    assert touchcal("report", "calibration.json")[0] == 0
    assert touchcal("compensate", "calibration.json", "poses.csv", "-o", "corrected.csv")[0] == 0
    assert touchcal("export", "calibration.json", "--format", "json", "-o", "robot.json")[0] == 0

    page, corrected = (far_off / "report.html").read_text(), (far_off / "corrected.csv").read_text()
    assert "107 of 107 parameters estimated" in page
    assert "start,corrected" in corrected


def test_a_fit_that_scatters_too_much_says_that_all_parameters_may_be_asked_for(far_off, touchcal):
    _, few, _ = touchcal("identify", "touches.csv", "--parameters", "identifiable", "--errors", "none")
    _, every, _ = touchcal("identify", "touches.csv")

    assert "--parameters all" in few
    assert "--parameters all" not in every


def test_json_summaries_have_what_the_design_promises(folder, touchcal):
    identified = json.loads(touchcal("identify", "touches.csv", "--json")[1])
    verified = json.loads(touchcal("verify", "calibration.json", "unseen.csv", "--json")[1])

    keys = {"rank", "estimated", "eliminated", "weak", "outliers", "fit", "held_out", "iterations", "solve_s"}
    assert keys <= identified.keys()
    assert {"n", "mean_mm", "rms_mm", "p95_mm", "max_mm", "promised_p95_mm"} <= verified.keys()
    assert verified["rms_mm"] < 3 * SIGMA


def test_the_same_seed_gives_the_same_calibration(folder, touchcal):
    touchcal("identify", "touches.csv", "-o", "a.json", "--seed", 3)
    touchcal("identify", "touches.csv", "-o", "b.json", "--seed", 3)
    a, b = (json.loads((folder / name).read_text()) for name in ("a.json", "b.json"))

    for document in (a, b):  # a time is what the machine has made of it
        del document["solve_s"], document["checksums"]["solve_s"]
    assert a == b


def test_touches_of_two_sessions_with_the_same_ids_are_told_apart(folder, touchcal):
    header, *lines = (folder / "touches.csv").read_text().splitlines()
    fields = header.split(",")
    renamed = [line.split(",") for line in lines[50:]]
    for row, line in zip(renamed, lines, strict=False):
        row[fields.index("id")] = line.split(",")[fields.index("id")]
    (folder / "touches.csv").write_text("\n".join([header, *lines[:50]]) + "\n")
    (folder / "more.csv").write_text("\n".join([header, *map(",".join, renamed)]) + "\n")

    code, _, _ = touchcal("identify", "touches.csv", "more.csv")

    assert code == 0
    assert "more:t1" in json.loads((folder / "calibration.json").read_text())["residuals"]


def test_one_percent_of_touches_wrong_by_5_mm_are_named(folder, touchcal):
    def change(lines):
        cells = lines[40].split(",")
        cells[7] = str(float(cells[7]) + 5)
        lines[40] = ",".join(cells)

    edit(folder / "touches.csv", change)

    code, out, _ = touchcal("identify", "touches.csv", "--json")

    assert code == 0
    assert list(json.loads(out)["outliers"]) == ["t40"]


def radians(lines):
    for i in range(1, len(lines)):
        cells = lines[i].split(",")
        cells[9:15] = [str(np.radians(float(c))) for c in cells[9:15]]
        lines[i] = ",".join(cells)


def metres(lines):
    for i in range(1, len(lines)):
        cells = lines[i].split(",")
        cells[7] = str(float(cells[7]) / 1000)
        lines[i] = ",".join(cells)


def unknown_face(lines):
    cells = lines[4].split(",")
    cells[3:8] = ["top-hihg", "", "", "", ""]
    lines[4] = ",".join(cells)


def not_a_number(lines):
    cells = lines[7].split(",")
    cells[10] = "nan"
    lines[7] = ",".join(cells)


BAD_TOUCHES = {
    "radians": (radians, "radians? write degrees"),
    "metres": (metres, "metres? write millimetres"),
    "unknown face": (unknown_face, r"touches.csv:5: jig 'step-block' has no face 'top-hihg'; did you mean 'top-high'?"),
    "not a number": (not_a_number, "touches.csv:8: q2_deg is 'nan', expected a number"),
    "duplicate id": (lambda lines: lines.append(lines[3]), "touches.csv:102: id 't3' stands already in line 4"),
}


@pytest.mark.parametrize("case", BAD_TOUCHES)
def test_bad_touches_get_one_sentence_and_nothing_is_written(case, folder, touchcal):
    change, sentence = BAD_TOUCHES[case]
    edit(folder / "touches.csv", change)
    before = sorted(p.name for p in folder.iterdir())

    code, out, err = touchcal("identify", "touches.csv")

    assert (code, out) == (2, "")
    assert sentence in err
    assert sorted(p.name for p in folder.iterdir()) == before


TOO_LITTLE = {
    "three touches": lambda lines: lines.__delitem__(slice(4, None)),
    "one face": lambda lines: lines.__setitem__(slice(1, None), [x for x in lines[1:] if ",1.0,0.0,0.0," in x]),
}


@pytest.mark.parametrize("case", TOO_LITTLE)
def test_touches_that_do_not_determine_the_zone_are_refused_and_nothing_is_written(case, folder, touchcal):
    edit(folder / "touches.csv", TOO_LITTLE[case])
    before = sorted(p.name for p in folder.iterdir())

    code, _, err = touchcal("identify", "touches.csv")

    assert code == 1
    assert "the zone is not determined: the tip may be" in err
    assert "make more touches, on other faces and with other wrist angles" in err
    assert sorted(p.name for p in folder.iterdir()) == before


def test_small_angles_are_read_as_degrees_when_the_user_says_so(folder, touchcal):
    edit(folder / "touches.csv", radians)

    _, _, err = touchcal("identify", "touches.csv", "--trust-units")

    assert "radians" not in err  # what a robot that hardly moves tells is another matter


def test_a_torn_last_line_is_refused(folder, touchcal):
    path = folder / "touches.csv"
    path.write_text(path.read_text()[:-30])

    code, _, err = touchcal("identify", "touches.csv")

    assert code == 2
    assert "touches.csv:101" in err
    assert not (folder / "calibration.json").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["identify", "none.csv"], "none.csv: no such file"),
        (["identify"], "nothing to identify from"),
        (["identify", "touches.csv", "--cell", "none.yaml"], "none.yaml: no such file"),
        (["identify", "touches.csv", "-o", "no/such/folder.json"], "cannot be written"),
        (["identify", "touches.csv", "--loss", "square"], "square"),
        (["identify", "touches.csv", "--parameters", "some"], "some"),
        (["identify", "touches.csv", "--parameters", "all", "--no-priors"], "not all parameters can be estimated"),
        (["verify", "touches.csv", "unseen.csv"], "not a calibration"),
        (["verify", "none.json", "unseen.csv"], "none.json: no such file"),
        (["plam"], "there is no command 'plam'; did you mean 'plan'?"),
        (["plan", "--nonsense"], "nonsense"),
    ],
)
def test_bad_arguments_get_one_sentence_and_exit_code_2(arguments, sentence, folder, touchcal):
    code, _, err = touchcal(*arguments)

    assert code == 2
    assert sentence in err
    assert "Traceback" not in err


def test_a_mistake_in_the_cell_is_told_with_its_line(folder, touchcal):
    edit(folder / "cell.yaml", lambda lines: lines.append("tuch: {sigma_mm: 0.05}"))

    code, _, err = touchcal("identify", "touches.csv")

    assert code == 2
    assert "cell.yaml:11: unknown key 'tuch'; did you mean 'touch'?" in err


def test_an_old_calibration_survives_a_failed_run(folder, touchcal):
    touchcal("identify", "touches.csv")
    before = (folder / "calibration.json").read_text()
    edit(folder / "touches.csv", not_a_number)

    touchcal("identify", "touches.csv")

    assert (folder / "calibration.json").read_text() == before


def test_a_reader_that_has_seen_enough_is_no_failure():
    command = f"{sys.executable} -c 'from oed.cli import main; main([\"--help\"])' | true"

    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)

    assert (done.stdout, done.stderr) == ("", "")


@pytest.fixture
def changing(arc_welder):
    """The touches of the sheets by a robot that changes: the share of a change of parameters that each touch feels."""

    def touches(change, share):
        rng, truth = np.random.default_rng(4), table_2(arc_welder)
        q = poses_over_jig(arc_welder, 160, rng)[:100]
        sound = touches_at(arc_welder, truth, q, rng, SIGMA)
        was, now = (touches_at(arc_welder, theta, q, rng, 0.0).offset for theta in (truth, truth + change))
        return with_offsets(sound, sound.offset + share * (now - was))

    return touches


def test_a_wire_cut_between_two_files_is_estimated_and_the_touches_serve_together(
    folder, touchcal, arc_welder, changing
):
    shorter = np.zeros(len(arc_welder.theta))
    shorter[-6:-3] = -2.5 * rotation(*table_2(arc_welder)[-3:])[:, 2]
    touches = changing(shorter, np.arange(100) >= 50)
    for name, part in (("before", np.arange(50)), ("after", np.arange(50, 100))):
        (folder / f"{name}.csv").write_text(touches_text(touches.take(part), arc_welder.robot))

    code, out, _ = touchcal("identify", "before.csv", "after.csv")

    words = " ".join(out.split())
    assert code == 0
    assert "from touch t51 on" in words
    assert float(words.split("the wire is ")[1].split()[0]) == pytest.approx(2.5, abs=0.1)
    verified = json.loads(touchcal("verify", "calibration.json", "unseen.csv", "--json")[1])
    assert verified["p95_mm"] < verified["promised_p95_mm"] < 0.4
    written = json.loads((folder / "calibration.json").read_text())
    shared = {s["name"]: s for s in written["shared"]}
    assert len(written["outliers"]) <= 1
    assert shared["stickout.t51"]["value"] == pytest.approx(-2.5, abs=4 * shared["stickout.t51"]["sigma"])


def test_a_drift_is_estimated_and_the_calibration_is_that_of_its_middle(folder, touchcal, arc_welder, changing):
    risen = np.zeros(len(arc_welder.theta))
    risen[2] = 0.8
    touches = changing(risen, np.linspace(-0.5, 0.5, 100))
    (folder / "touches.csv").write_text(touches_text(touches, arc_welder.robot))

    code, out, _ = touchcal("identify", "touches.csv")

    assert code == 0
    assert float(" ".join(out.split()).split("z ")[1].split()[0]) == pytest.approx(0.8, abs=0.1)
    verified = json.loads(touchcal("verify", "calibration.json", "unseen.csv", "--json")[1])
    assert verified["p95_mm"] < verified["promised_p95_mm"] < 0.4


@pytest.mark.parametrize("statuses", [[], ["miss", "miss"]])
def test_a_table_without_a_counted_touch_is_answered_in_one_sentence(folder, touchcal, statuses):
    header, *rows = (folder / "touches.csv").read_text().splitlines()
    place = header.split(",").index("status")
    columns = [row.split(",") for row in rows[: len(statuses)]]
    for row, status in zip(columns, statuses, strict=True):
        row[place] = status
    (folder / "none.csv").write_text("\n".join([header, *map(",".join, columns)]) + "\n")

    code, _, said = touchcal("identify", "none.csv", "-o", "none.json")

    assert (code, said.count("\n"), (folder / "none.json").exists()) == (2, 1, False)
    assert "nothing to identify from: no touch of status hit" in said
