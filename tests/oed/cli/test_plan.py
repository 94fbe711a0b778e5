"""`touchcal plan` as a user meets it: a whole plan judged by other means, and why there sometimes is none."""

import csv
import json
import re
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from itertools import pairwise

import numpy as np
import pytest
from drawings import balls
from oracle import forward

from identify.model.cell import Cell
from identify.model.io.description import library, read_cell
from oed.cli import main
from oed.cli.plan import _certificate
from probe.motion.clearance import MARGIN, NEAR, Clearance

N = 40
MICROMETRE = 1e-3
STICKOUT = 18.0  # [mm] of bare wire


@dataclass
class Made:
    """A plan as it stands in its file, and what was said of it."""

    cell: Cell
    rows: list[dict[str, str]]
    told: dict
    out: str

    def joints(self, prefix=""):
        """Joint values [rad] of a group of columns; NaN where they are empty."""
        names = [f"{prefix}q{k + 1}_deg" for k in range(6)]
        return np.radians([[float(row[name] or "nan") for name in names] for row in self.rows])

    def legs(self):
        """Straight ways between touches, ends included, by the postures in between."""
        vias = [self.joints(f"via{k + 1}_") for k in range(9) if f"via{k + 1}_q1_deg" in self.rows[0]]
        path = [q for i, approach in enumerate(self.joints("approach_")) for q in (*(v[i] for v in vias), approach)]
        path = [q for q in path if not np.isnan(q).any()]
        return list(pairwise(path))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The plan that the command makes for the cell of the library, everything in it."""
    folder = tmp_path_factory.mktemp("plan")
    cell = folder / "cell.yaml"
    cell.write_text(library("cells")["arc-welder"].read_text())
    with redirect_stdout(StringIO()) as said, pytest.raises(SystemExit) as stop:
        main(["plan", "-n", str(N), "--cell", str(cell), "-o", str(folder / "plan.csv")])
    assert stop.value.code == 0
    with (folder / "plan.csv").open() as file:
        rows = list(csv.DictReader(file))
    return Made(read_cell(cell), rows, json.loads((folder / "plan.json").read_text()), said.getvalue())


def gaps(cell, clearance, q):
    """Distance of every capsule from every box [mm], by points along the capsules."""
    boxes = [(np.array(b.lower), np.array(b.upper)) for b in cell.jig.boxes]
    along = balls(cell, clearance.capsules, q, 60)
    return np.array(
        [
            [np.linalg.norm(np.maximum(np.maximum(lo - p, p - hi), 0), axis=1).min() - c.radius for lo, hi in boxes]
            for p, c in zip(along, clearance.capsules, strict=True)
            if c.link
        ]
    )


def bare_wire(cell, q, least=0.0):
    """Distance of the bare wire from the nearest box [mm], from `least` behind the tip on."""
    T = forward(cell.robot, q, cell.theta)
    wire = T[:3, 3] - np.linspace(least, STICKOUT, 20)[:, None] * T[:3, 2]
    boxes = [(np.array(b.lower), np.array(b.upper)) for b in cell.jig.boxes]
    return min(np.linalg.norm(np.maximum(np.maximum(lo - wire, wire - hi), 0), axis=1).min() for lo, hi in boxes)


def test_every_touch_meets_its_face_to_a_micrometre_within_limits_and_tilt(made):
    cell, faces = made.cell, made.cell.jig.by_name

    for row, q in zip(made.rows, made.joints(), strict=True):
        T, face = forward(cell.robot, q, cell.theta), faces[row["face"]]
        lean = -float(face.normal @ T[:3, 2])
        height = float(face.normal @ (T[:3, 3] - face.origin))
        assert height == pytest.approx(cell.wire.radius * np.sqrt(1 - min(lean, 1.0) ** 2), abs=MICROMETRE)
        assert lean >= np.cos(cell.touch.max_tilt) - 1e-8
        point = np.array([float(row[name]) for name in ("x_mm", "y_mm", "z_mm")])
        np.testing.assert_allclose(T[:3, 3] - height * face.normal, point, atol=2 * MICROMETRE)
        inside = face.fractions(point) * face.size
        assert ((inside > 3 - MICROMETRE) & (inside < face.size - 3 + MICROMETRE)).all()


def test_every_posture_stays_within_the_joint_limits(made):
    robot = made.cell.robot
    postures = [q for leg in made.legs() for q in leg] + list(made.joints())

    assert ((postures >= robot.lower - 1e-9) & (postures <= robot.upper + 1e-9)).all()


def test_arm_and_torch_keep_their_margin_from_approach_to_contact(made):
    cell, clearance = made.cell, Clearance(made.cell, made.cell.theta)
    torch = [c.link == len(cell.robot.joints) for c in clearance.capsules if c.link]

    for row, q, approach in zip(made.rows, made.joints(), made.joints("approach_"), strict=True):
        point = np.array([float(row[name]) for name in ("x_mm", "y_mm", "z_mm")])
        below = point - 0.1 * cell.jig.by_name[row["face"]].normal
        own = [bool(((below >= b.lower) & (below <= b.upper)).all()) for b in cell.jig.boxes]
        least = np.where(np.outer(torch, own), NEAR, MARGIN)
        for share in (0.0, 0.5, 1.0):
            assert (gaps(cell, clearance, approach + share * (q - approach)) >= least - 1e-6).all()
        assert bare_wire(cell, approach) > 3.0
        assert bare_wire(cell, q, least=6.0) > 1.0


def test_nothing_comes_near_to_the_jig_on_the_ways_between_touches(made):
    cell, clearance = made.cell, Clearance(made.cell, made.cell.theta)

    for start, end in made.legs():
        for share in np.linspace(0, 1, 9):
            q = start + share * (end - start)
            assert gaps(cell, clearance, q).min() > MARGIN / 2 - 2.0  # [mm]; looked at elsewhere, it moves in between
            assert bare_wire(cell, q) > 3.0 - 1.0


def test_a_robot_that_may_be_far_off_is_kept_farther_from_the_jig(made):
    """Half of its ways keep more than ten millimetres, with approaches of twenty-five."""
    near = [min(bare_wire(made.cell, a + s * (b - a)) for s in np.linspace(0, 1, 9)) for a, b in made.legs()]

    assert np.median(near) > 10.0


def test_the_command_tells_the_promise_the_curve_the_certificates_and_what_limits_it(made):
    promise = made.told["promise"]
    assert 3 < promise["rms_mm"] < 30  # a third of the touches miss, of some robots most
    assert promise["rms_mm"] > np.sqrt(made.told["indices"]["V"])  # V takes it that no touch misses
    for words in (
        f"{N} touches, criterion V, about",
        f"promised tip error in the weld zone: RMS {promise['rms_mm']:.3f} mm, 95 % {promise['p95_mm']:.3f} mm",
        "touches   ",
        "95 % [mm]",
        "indices: O1 ",
        "touches on offer that clear ways join",
        "of the best possible over all touches of the faces that can be made",
        "wrote ",
    ):
        assert words in made.out
    assert made.told["touches"] == len(made.rows) == N
    assert 0.5 < made.told["manifold"] < made.told["efficiency"] < 1
    assert made.told["unseen"] == []
    assert any(
        "of the remaining tip variance comes from one combination of unknowns: " in note for note in made.told["notes"]
    )


def test_faces_that_are_never_reached_are_told_with_the_reason(made):
    notes = "\n".join(made.told["notes"])

    assert "face 'back-low' is reached only with the wire about 71 degrees off its normal" in notes
    assert re.search(r"the tip may be up to \d\d mm off \(2.5 sigma\)", notes)
    assert re.search(
        r"of \d+ touches about \d+\.\d miss \(\d+\.\d %\): .* begin in contact or behind their face", notes
    )


@pytest.fixture
def cell_file(tmp_path):
    """A function that writes the cell of the library with a line changed."""

    def write(old="", new=""):
        text = library("cells")["arc-welder"].read_text()
        assert old in text
        path = tmp_path / "cell.yaml"
        path.write_text(text.replace(old, new))
        return path

    return write


@pytest.mark.usefixtures("few_candidates")
@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["-n", 0], "0 touches are asked for"),
        (["-n", 30, "--target", 0.1], "give one, the other follows from it"),
        (["--criterion", "X"], "criterion 'X' is not known"),
        (["--target", -1], "target -1 mm: write the 95 % tip error"),
        (["--seconds", 0], "seconds 0: write how long the plan may search, above 0"),
        (["--target", 0.01], "no number of touches can promise it.*touches of robots with these.*miss.*campaign"),
    ],
)
def test_a_plan_that_cannot_be_is_refused_in_one_sentence(cell_file, tmp_path, touchcal, options, says):
    code, out, err = touchcal("plan", "--cell", cell_file(), "-o", tmp_path / "plan.csv", *options)

    assert (code, out) == (2, "")
    assert re.search(says, " ".join(err.split()))
    assert not (tmp_path / "plan.csv").exists()


@pytest.mark.usefixtures("few_candidates")
def test_fewer_touches_than_parameters_are_a_plan_that_says_what_it_does_not_show(cell_file, tmp_path, touchcal):
    code, _, err = touchcal("plan", "--cell", cell_file(), "-o", tmp_path / "plan.csv", "-n", 20)
    told = json.loads((tmp_path / "plan.json").read_text())

    assert (code, err) == (0, "")
    assert told["touches"] == 20
    assert told["promise"]["rms_mm"] > 1.0
    assert "A" not in told["indices"]
    assert told["indices"]["D"] == 0  # the touches alone determine nothing
    assert len(told["unseen"]) >= 5  # 25 identifiable parameters, 20 touches
    cures = [
        line.rpartition("; ")[2] for line in told["unseen"]
    ]  # which directions a face would show, hangs on the plan
    assert all(cure == "make more touches" or cure.startswith("add a face") for cure in cures)
    assert cures.count("make more touches") > len(cures) / 2


def test_a_jig_out_of_reach_is_told_with_how_far(cell_file, tmp_path, touchcal):
    far = cell_file("x_mm: 340, y_mm: 740", "x_mm: 340, y_mm: 4740")

    code, _, err = touchcal("plan", "-n", 30, "--cell", far, "-o", tmp_path / "plan.csv")

    assert code == 2
    assert re.search(r"face 'top-low' is out of reach: the tip comes no nearer than 3\d\d\d mm; move the jig", err)


@pytest.mark.parametrize(
    ("share", "words"), [(0.9, "at least 90.0 % of the best possible over"), (1.01, "better than any choice of")]
)
def test_touches_that_were_moved_are_not_said_to_be_more_than_the_best(share, words):
    answer = {"efficiency": share, "manifold": None, "candidates": {"joined": 90, "offered": 100}}
    (line,) = _certificate(answer)
    assert line.startswith(f"{words} the 90 of 100 touches on offer")
