"""A correction as a difference that `patch` turns into the corrected program, and reasons counted."""

import shutil
import subprocess

import numpy as np
import pytest
from identified import JOB, identified
from programs import CELL, TRUTH

from identify.programs.fixing import Fixed, fix
from identify.programs.records import Mention


@pytest.fixture(scope="module")
def fixed():
    job = JOB.replace("///POSTYPE PULSE\n///PULSE\nC00001=1,2,3,4,5,6\n", "").replace("NPOS 2", "NPOS 1")
    (found,) = fix(identified(CELL, TRUTH), {"SEAM.JBI": job.encode()})
    return found


@pytest.mark.skipif(shutil.which("patch") is None, reason="patch is not installed")
def test_the_difference_turns_the_old_program_into_the_new_one(fixed, tmp_path):
    (tmp_path / "SEAM.JBI").write_bytes(fixed.before)

    subprocess.run(["patch", "-p1", "--binary", "-s"], input=fixed.diff, cwd=tmp_path, check=True)

    assert (tmp_path / "SEAM.JBI").read_bytes() == fixed.after
    assert fixed.after != fixed.before


def test_joints_are_moved_by_as_much_as_the_shift_says(fixed):
    old, new = (
        np.radians([float(word) for word in text.split(b"C00000=")[1].split(b"\n")[0].split(b",")])
        for text in (fixed.before, fixed.after)
    )
    believed, true = CELL.theta.copy(), TRUTH

    target = CELL.kinematics.tip(old[None], believed)[0][0]

    assert np.linalg.norm(CELL.kinematics.tip(new[None], true)[0][0] - target) < 0.05  # [mm], by the job's decimals
    assert fixed.whole
    assert fixed.shift.shape == (1,)


def test_reasons_are_counted_by_what_stands_before_the_colon():
    left = tuple(Mention("a", i, f"P{i}", why) for i, why in enumerate(("frame: one", "limit: j1", "frame: two")))
    none = np.zeros(0)

    assert Fixed("a", b"", b"", none, left, False, 0, 0.0, (), ()).reasons == {"frame": 2, "limit": 1}
