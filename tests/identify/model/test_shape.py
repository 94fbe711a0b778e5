"""A mesh of a URDF stands on its link in millimetres."""

import numpy as np
import pytest
from meshed import box, stl

from identify.model.files import InputError
from identify.model.frames import transform
from identify.model.shape import Shape, entries


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


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere", "mesh"])
def test_lines_come_into_solids_where_coal_has_their_surface(kind, tmp_path, rng):
    coal = pytest.importorskip("coal")
    path = tmp_path / "box.stl"
    path.write_bytes(stl(*box((80, 120, 60))))
    size = {"box": (80.0, 120.0, 60.0), "cylinder": (30.0, 90.0), "sphere": (35.0,), "mesh": (1.0, 1.0, 1.0)}[kind]
    shape = Shape(0, kind, kind, size, transform(np.array([10.0, 20.0, 30.0, 0.4, 0.3, -0.2])), "box.stl", path)
    start = 200 * rng.normal(size=(300, 3))
    way = 1.6 * (20 * rng.normal(size=(300, 3)) + shape.pose[:3, 3] - start)

    at = entries(shape, start, way)

    solids = {"box": coal.Box, "cylinder": coal.Cylinder, "sphere": coal.Sphere, "mesh": coal.Box}
    solid = solids[kind](*((80.0, 120.0, 60.0) if kind == "mesh" else size))
    place = coal.Transform3s(shape.pose[:3, :3], shape.pose[:3, 3])

    def distance(a, b):
        points = coal.Capsule(1e-6, max(float(np.linalg.norm(b - a)), 1e-9))
        turn = np.linalg.svd((b - a)[None])[2][[1, 2, 0]].T if np.linalg.norm(b - a) > 0 else np.eye(3)
        turn[:, 0] *= np.sign(np.linalg.det(turn))
        return coal.distance(points, coal.Transform3s(turn, (a + b) / 2), solid, place, request, coal.DistanceResult())

    request = coal.DistanceRequest()
    ends = np.where(np.isfinite(at), at, 1.0)
    outside = np.array([distance(a, a + 0.99 * s * w) for a, s, w in zip(start, ends, way, strict=True)])
    begun = np.array([distance(a, a) <= 0 for a in start])
    assert np.isfinite(at).sum() > 50
    assert kind == "mesh" or (begun == (at == 0)).all()
    assert (outside[~begun] > -1e-3).all()  # nothing is met before
    met = np.array([distance(a + s * w, a + s * w) for a, s, w in zip(start, ends, way, strict=True)])
    assert np.abs(met[np.isfinite(at) & ~begun]).max() < 1e-2
