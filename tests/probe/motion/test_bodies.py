"""Capsules around solids and meshes hold all of them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from meshed import box, stl

from identify.model.shape import Shape
from probe.motion.bodies import around

numbers = st.floats(1, 500)
KINDS = {"box": 3, "cylinder": 2, "sphere": 1}


@given(kind=st.sampled_from(list(KINDS)), data=st.data())
def test_the_capsule_around_a_solid_holds_all_of_it(kind, data):
    size = data.draw(st.tuples(*[numbers] * KINDS[kind]))
    R, _ = np.linalg.qr(np.random.default_rng(data.draw(st.integers(0, 999))).normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R * np.linalg.det(R), (30, -20, 10)

    capsule = around(Shape(1, "any", kind, size, pose))

    turn = np.linspace(0, 2 * np.pi, 24)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    if kind == "box":
        p = box(size)[0]
    elif kind == "cylinder":
        p = np.concatenate([np.column_stack([size[0] * ring, np.full(24, z)]) for z in (-size[1] / 2, size[1] / 2)])
    else:
        p = size[0] * np.concatenate([np.column_stack([ring, 0 * turn]), np.column_stack([0 * turn, ring])])
    assert reach(capsule, p @ pose[:3, :3].T + pose[:3, 3]) <= 1e-9 * max(size)


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 8))
def test_the_capsule_around_a_mesh_holds_all_of_it(seed, count, tmp_path_factory):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(3 * count, 3)) * rng.uniform(0.1, 300, 3)
    path = tmp_path_factory.getbasetemp() / "any.stl"
    path.write_bytes(stl(corners, np.arange(3 * count).reshape(-1, 3)))

    capsule = around(Shape(1, "any", "mesh", (1.0, 1.0, 1.0), np.eye(4), "any.stl", path))

    assert reach(capsule, np.float32(corners).astype(float)) <= 1e-6


def reach(capsule, points):
    """How far points stand out of a capsule [mm]."""
    a, b = np.array(capsule.start), np.array(capsule.end)
    s = np.clip(((points - a) @ (b - a)) / max((b - a) @ (b - a), 1e-300), 0, 1)
    return (np.linalg.norm(points - a - s[:, None] * (b - a), axis=1) - capsule.radius).max()
