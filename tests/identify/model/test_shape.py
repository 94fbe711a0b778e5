"""A mesh of a URDF stands on its link in millimetres."""

import numpy as np
import pytest
from meshed import box, stl

from identify.model.files import InputError
from identify.model.frames import transform
from identify.model.shape import Shape


def test_a_mesh_is_scaled_then_turned_then_shifted(tmp_path):
    path = tmp_path / "box.stl"
    path.write_bytes(stl(*box((1, 2, 3))))
    pose = transform(np.array([10.0, 20.0, 30.0, np.pi / 2, 0.0, 0.0]))  # x of the mesh along y of the link

    vertices, _ = Shape(1, "any", "mesh", (100.0, 100.0, 100.0), pose, "box.stl", path).mesh

    assert vertices.min(axis=0) == pytest.approx([10 - 100, 20 - 50, 30 - 150])
    assert vertices.max(axis=0) == pytest.approx([10 + 100, 20 + 50, 30 + 150])


def test_a_mesh_that_was_drawn_in_millimetres_is_asked_about(tmp_path):
    path = tmp_path / "base.stl"
    path.write_bytes(stl(*box((180, 90, 60))))

    with pytest.raises(InputError, match=r"base.stl: the mesh of link 'base' is 180 m wide.*scale=\"0.001"):
        _ = Shape(0, "base", "mesh", (1000.0, 1000.0, 1000.0), np.eye(4), "base.stl", path).mesh
