"""poses.csv: what it holds in millimetres and degrees, and numbers that look like other units."""

import numpy as np
import pytest

from identify.model.files import InputError
from identify.model.io.poses import read_poses

HEADER = "id,x_mm,y_mm,z_mm,rz_deg,ry_deg,rx_deg\n"


def test_poses_are_read_in_millimetres_and_radians(write):
    poses = read_poses(write(HEADER + "a,100,-20,30,90,0,-180\nb,1,2,3,0,45,0\n"))

    assert poses.ids == ("a", "b")
    np.testing.assert_allclose(
        poses.pose, [[100, -20, 30, np.pi / 2, 0, -np.pi], [1, 2, 3, 0, np.pi / 4, 0]], atol=1e-15
    )


@pytest.mark.parametrize(
    ("row", "line", "sentence"),
    [
        ("a,100,20,30,1.5708,0,0", 2, "rz_deg is 1.5708: radians?"),
        ("a,100,20,30,0,0,-3.1416", 2, "rx_deg is -3.1416: radians?"),
        ("a,0.1,0.02,0.03,90,0,0", 0, "no pose lies 5 mm from the origin: metres?"),
        ("a,100,20,,90,0,0", 2, "z_mm is"),
    ],
)
def test_a_pose_in_other_units_is_refused_with_its_line(row, line, sentence, write):
    with pytest.raises(InputError) as error:
        read_poses(write(HEADER + row + "\n"))

    assert [(m.line, m.text.startswith(sentence)) for m in error.value.mistakes] == [(line, True)]


def test_units_may_be_trusted(write):
    path = write(HEADER + "a,0.1,0.02,0.03,1.5708,0,0\n")

    assert len(read_poses(path, trust_units=True)) == 1
