"""A part from CAD becomes a jig that can be touched."""

import numpy as np
from meshed import box, stl

from identify.model.io.description import read_jig


def test_a_part_becomes_a_jig_with_the_part_as_its_obstacle(touchcal, tmp_path):
    (tmp_path / "cad").mkdir()
    (tmp_path / "cad" / "block.stl").write_bytes(stl(*box((0.2, 0.1, 0.05), (0, 0, 0.025))))

    code, said, _ = touchcal(
        "jig", tmp_path / "cad" / "block.stl", "-o", tmp_path / "jig.yaml", "--scale", 1000, "--tolerance", 0.05
    )

    jig = read_jig(tmp_path / "jig.yaml")
    assert code == 0
    assert "5 faces" in said
    assert sorted(face.name for face in jig.faces) == [
        "back_0_-50_25",
        "front_0_50_25",
        "left_-100_0_25",
        "right_100_0_25",
        "top_0_0_50",
    ]
    assert all(face.tolerance == 0.05 for face in jig.faces)
    assert np.ptp(jig.obstacles[0].mesh[0], axis=0).round(3).tolist() == [200, 100, 50]


def test_a_mesh_without_a_face_to_touch_and_a_file_that_is_no_mesh_are_said_in_a_sentence(touchcal, tmp_path):
    (tmp_path / "small.stl").write_bytes(stl(*box((0.2, 0.1, 0.05))))
    (tmp_path / "part.step").write_text("ISO-10303-21")

    small = touchcal("jig", tmp_path / "small.stl", "-o", tmp_path / "jig.yaml")
    step = touchcal("jig", tmp_path / "part.step", "-o", tmp_path / "jig.yaml")

    assert (small[0], step[0]) == (2, 2)
    assert "--scale 1000" in small[2]
    assert "part.step: a mesh is a file .stl or .obj" in step[2]
    assert not (tmp_path / "jig.yaml").exists()
