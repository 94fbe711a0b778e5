"""Meshes as three formats write them: corners once, volume kept, what is broken told by its name."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshed import box, obj, stl, text_stl

from identify.model.files import InputError
from identify.model.meshes import read_mesh

edges = st.tuples(*[st.floats(0.1, 1000)] * 3)


places = st.tuples(*[st.floats(-1000, 1000)] * 3)


WRITERS = {"binary.stl": stl, "text.STL": text_stl, "any.obj": obj}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("meshes")


def volume(vertices, triangles):
    """By the divergence theorem."""
    return np.linalg.det(vertices[triangles]).sum() / 6


@pytest.mark.parametrize("name", WRITERS)
@given(size=edges, middle=places)
def test_a_mesh_has_its_corners_once_and_its_volume(folder, name, size, middle):
    vertices, triangles = box(size, middle)
    (folder / name).write_bytes(WRITERS[name](vertices, triangles))

    read, faces = read_mesh(folder / name)

    assert len(read) == 8
    assert len(faces) == 12
    assert abs(volume(read - read.mean(axis=0), faces)) == pytest.approx(np.prod(size), rel=0.02)  # single precision
    assert read.min(axis=0) == pytest.approx(vertices.min(axis=0), rel=1e-6, abs=1e-6)


def test_faces_of_an_obj_may_have_more_corners_and_count_backwards(folder):
    (folder / "square.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 -2 -1\n")

    vertices, triangles = read_mesh(folder / "square.obj")

    corners = vertices[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(1)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("cut.stl", stl(*box((1, 1, 1)))[:-30], r"cut.stl: not a mesh that can be read: 654 bytes, expected 684"),
        ("short.stl", b"hello", "not a mesh that can be read: 5 bytes"),
        ("text.stl", text_stl(*box((1, 1, 1)))[:300], "text STL with .* vertices in .* whole facets"),
        ("word.stl", text_stl(*box((1, 1, 1))).replace(b"0.5", b"half"), "could not convert string to float"),
        ("empty.stl", stl((), ()), "the mesh has no triangles; export it again"),
        ("nan.stl", stl(np.full((3, 3), np.nan), ((0, 1, 2),)), "vertices that are not finite"),
        ("far.obj", b"v 0 0 0\nf 1 2 3\n", "line 2 names vertex 2 of 1"),
    ],
)
def test_a_broken_mesh_is_told_by_its_name(folder, name, content, message):
    (folder / name).write_bytes(content)

    with pytest.raises(InputError, match=message):
        read_mesh(folder / name)
