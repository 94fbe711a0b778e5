"""Faces of parts whose drawing is known: a fixture of 20 faces, solids that stand on each other, and a leaning one."""

from pathlib import Path

import numpy as np
import pytest
from meshed import box, obj, stl
from scipy.spatial.transform import Rotation

from identify.model.io.description import read_jig
from identify.model.io.facets import faces_of
from identify.model.meshes import read_mesh


def corners(face):
    """The corners of a face, in an order that does not depend on where it begins."""
    p = np.stack([face.origin, face.origin + face.u, face.origin + face.v, face.origin + face.u + face.v])
    return p[np.lexsort(np.round(p, 2).T)]


def alike(faces, face):
    """Of some faces, those at the same place, seen from the same side."""
    same = [f for f in faces if f.normal @ face.normal > 1 - 1e-9]
    return [f for f in same if np.abs(corners(f) - corners(face)).max() <= 1e-3]  # [mm]


@pytest.fixture(scope="module")
def fixture(shared_data: Path):
    """The U fixture, whose ramp leans by 30 degrees."""
    return read_jig(shared_data / "jigs" / "u-fixture.yaml")


def drawn(faces):
    """Two triangles a face."""
    vertices = np.concatenate([[f.origin, f.origin + f.u, f.origin + f.u + f.v, f.origin + f.v] for f in faces])
    return vertices, [
        (4 * i + a, 4 * i + b, 4 * i + c) for i in range(len(faces)) for a, b, c in ((0, 1, 2), (0, 2, 3))
    ]


@pytest.mark.parametrize(("form", "suffix"), [(stl, ".stl"), (obj, ".obj")])
def test_the_mesh_of_the_fixture_gives_its_twenty_faces(fixture, tmp_path, form, suffix):
    (tmp_path / f"u{suffix}").write_bytes(form(*drawn(fixture.faces)))

    found = faces_of(read_mesh(tmp_path / f"u{suffix}"))

    assert len(found) == len(fixture.faces) == 20
    assert all(len(alike(found, face)) == 1 for face in fixture.faces)
    assert len({face.name for face in found}) == 20


def test_what_another_solid_covers_or_stands_close_before_is_no_face():
    parts = [((100, 100, 40), (0, 0, 20)), ((40, 40, 60), (0, 0, 70)), ((100, 10, 100), (0, 75, 50))]
    vertices, triangles = zip(*[box(*part) for part in parts], strict=True)
    solid = np.concatenate(vertices), np.concatenate([t + 8 * i for i, t in enumerate(triangles)])

    found = faces_of(solid)

    tops = sorted(tuple(np.round(face.size).tolist()) for face in found if face.normal[2] > 0.9)
    assert tops == [(30.0, 100.0), (30.0, 100.0), (40.0, 40.0), (100.0, 10.0), (100.0, 30.0), (100.0, 30.0)]
    assert not [f for f in found if f.normal[2] < -0.2]
    low = [f for f in found if f.normal[1] > 0.9 and abs(f.offset - 50) < 1]
    assert not low  # the wall stands 20 mm before it


def test_a_leaning_plate_gives_its_upper_side():
    turn = Rotation.from_euler("zyx", [20, -15, 10], degrees=True).as_matrix()
    vertices, triangles = box((120, 80, 30))

    found = faces_of((vertices @ turn.T + [10, 20, 300], triangles))

    top = next(f for f in found if f.normal @ turn[:, 2] > 1 - 1e-9)
    assert sorted(top.size) == pytest.approx([80, 120], abs=1e-3)
    assert top.name.startswith("slope_")
