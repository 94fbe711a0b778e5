"""Meshes of an arm among the boxes of a jig: distances by another method, and what capsules around them would say."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshed import LINKS, box, collision, mesh, stl, written
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from identify.model.cell import Cell, Zone
from identify.model.io.description import library, read_jig
from identify.model.joint import Capsule
from identify.model.shape import Shape
from identify.model.urdf.chain import read_urdf
from oed.candidates.candidates import candidates
from probe.motion.bodies import around
from probe.motion.clearance import CLEAR, MARGIN, Clearance
from probe.motion.edges import FINE, Edges
from probe.motion.obstacles import Obstacle

pytest.importorskip("coal")
from probe.motion.mesh_distance import Exact

BASE = np.array([200.0, 702.0, 212.0, -np.pi / 2, 0.0, 0.0])
TOOL = np.array([0.0, 0.0, 300.0, 0.0, np.radians(-18), 0.0])
ZONE = Zone(np.array([[0.0, 400.0], [0.0, 300.0], [0.0, 250.0]]), np.radians(60))
BOXES = {name: (1000 * np.array(size), 1000 * np.array(middle)) for name, _, size, middle in LINKS}


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    robot = read_urdf(written(tmp_path_factory.mktemp("arm")), "base_link", "flange")
    return Cell(robot, read_jig(library("jigs")["step-block"]), BASE, TOOL, zone=ZONE)


def apart(T, size, U, other):
    """Distance of two boxes [mm] that stand at T and U: least squares over points of both (Stark and Parker 1995)."""
    A = np.hstack([T[:3, :3], -U[:3, :3]])
    half = np.concatenate([size, other]) / 2 + 1e-12
    found = lsq_linear(A, U[:3, 3] - T[:3, 3], (-half, half), method="bvls", tol=1e-14)
    return np.sqrt(2 * found.cost)


def stands(cell, q, name):
    """Where the box of a link is, in the jig frame; by the shapes' places, which have tests of their own."""
    shape = next(s for s in cell.robot.shapes if s.name == name)
    T = np.vstack([cell.kinematics.links(q[None], cell.theta)[shape.link][0], [0, 0, 0, 1]]) @ shape.pose
    T[:3, 3] += T[:3, :3] @ BOXES[name][1]
    return T


def outside(cell, q):
    """Distance of the moving links from the boxes of the jig."""
    out = np.inf
    for solid in cell.jig.boxes:
        low, high = np.array(solid.lower), np.array(solid.upper)
        U = np.eye(4)
        U[:3, 3] = (low + high) / 2
        for name, *_ in LINKS[1:]:
            out = min(out, apart(stands(cell, q, name), BOXES[name][0], U, high - low))
    return out


def inside(cell, q, far=2):
    """Distance of links from each other that are not neighbours, nor drawn into each other."""
    links = [s.name for s in cell.robot.shapes]
    boxes = [(stands(cell, q, name), BOXES[name][0]) for name in links]
    pairs = [(i, j) for i in range(len(links)) for j in range(i) if i - j >= far]
    return min(apart(*boxes[i], *boxes[j]) for i, j in pairs)


def bare(cell, nearer=350.0):
    """Without the torch, whose capsules have tests of their own, and nearer to the jig [mm]."""
    return replace(cell, tool=np.zeros(6), base=cell.base - [0, nearer, nearer / 2, 0, 0, 0])


def test_distances_of_meshes_from_the_jig_and_from_each_other_are_those_of_boxes(cell, rng):
    cell = bare(cell)
    clearance = Clearance(cell, cell.theta)
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (60, 6))

    jig, arm = clearance.gaps(q)

    assert jig == pytest.approx([outside(cell, row) for row in q], abs=1e-4)  # [mm]
    assert arm == pytest.approx([inside(cell, row) for row in q], abs=1e-4)
    assert 3 < (jig < 1).sum() < 57


def test_a_posture_is_refused_where_a_mesh_is_too_near_and_only_there(cell, rng):
    cell = bare(cell)
    clearance = Clearance(cell, cell.theta)
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (150, 6))
    margin = rng.uniform(0, 40, len(q))

    hit = clearance.hits(q, margin=margin)

    near = np.array([outside(cell, row) for row in q]) < margin
    folded = np.array([inside(cell, row) for row in q]) < np.minimum(margin, MARGIN)
    assert ((hit != CLEAR) == (near | folded)).all()
    assert (hit[near & ~folded] < len(clearance.solids)).all()
    assert (hit[folded & ~near] == len(clearance.solids)).all()
    assert 10 < (hit == CLEAR).sum() < 140


def test_capsules_around_meshes_refuse_more_and_never_less(cell, rng, monkeypatch):
    cell = bare(cell)
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (400, 6))
    exact = Clearance(cell, cell.theta)
    solids = exact.hits(q)
    monkeypatch.setattr("probe.motion.clearance.exact_meshes", lambda: False)
    monkeypatch.setattr("probe.motion.bodies.exact_meshes", lambda: False)

    capsules = Clearance(cell, cell.theta)

    assert capsules.exact is None
    outer = [capsules.gaps(q)[0] <= MARGIN, exact.gaps(q)[0] <= MARGIN]
    assert (outer[0] >= outer[1]).all()
    assert (capsules.hits(q)[solids == CLEAR] != CLEAR).sum() > 20  # what only the meshes themselves allow
    assert capsules.notes == (
        "collision: the arm is judged by capsules around its shapes; to judge the shapes themselves: "
        "pip install 'touchcal[collision]' (Linux, macOS)",
    )


def test_a_mesh_hits_where_the_thin_capsule_of_a_robot_file_does_not(cell, rng):
    thin = tuple(Capsule(s.link, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0) for s in cell.robot.shapes if s.link < 6)
    cell = bare(cell)
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (200, 6))
    drawn = replace(cell, robot=replace(cell.robot, shapes=(), capsules=thin))
    free = Clearance(drawn, cell.theta).hits(q) == CLEAR

    hit = Clearance(cell, cell.theta).hits(q[free]) != CLEAR

    assert hit.sum() > 10


def test_neighbours_and_shapes_that_are_drawn_into_each_other_do_not_count(cell, tmp_path):
    (tmp_path / "long.stl").write_bytes(
        stl(*box((0.6, 0.05, 0.05)))
    )  # reaches from the fore arm through elbow and upper
    reaching = collision(mesh(str(tmp_path / "long.stl")))
    robot = read_urdf(written(tmp_path, fore=reaching), "base_link", "flange")
    cell = bare(replace(cell, robot=robot))

    clearance = Clearance(cell, cell.theta)

    names = {frozenset((clearance.bodies[i].shape.name, clearance.bodies[j].shape.name)) for i, j in clearance.pairs}
    assert frozenset(("fore", "upper")) not in names  # they meet at zero
    assert frozenset(("fore", "elbow")) not in names  # neighbours
    assert frozenset(("fore", "turret")) in names


def test_touches_and_ways_keep_the_meshes_clear(cell, rng):
    found = candidates(cell, rng, 150)

    arm = bare(cell, 0.0)
    assert min(outside(arm, q) for q in found.q[:40]) >= MARGIN - 1e-4
    assert min(outside(arm, q) for q in found.approach[:40]) >= MARGIN - 1e-4
    assert min(inside(arm, q) for q in found.q[:40]) >= MARGIN - 1e-4
    edges = Edges(Clearance(cell, cell.theta))
    start, end = found.approach[:-1], found.approach[1:]
    clear = edges.clear(start, end, FINE)
    assert clear.any()
    for a, b in zip(start[clear][:5], end[clear][:5], strict=True):
        assert min(outside(arm, a + s * (b - a)) for s in np.linspace(0, 1, 9)) >= MARGIN / 2 - 1e-4


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


def test_a_mesh_may_stand_around_what_it_does_not_touch(tmp_path, rng):
    parts = (((300, 60, 100), (0, 0, -150)), ((60, 60, 300), (120, 0, 0)), ((60, 60, 300), (-120, 0, 0)))  # a U
    corners, faces = zip(*[box(size, middle) for size, middle in parts], strict=True)
    triangles = np.concatenate([face + 8 * k for k, face in enumerate(faces)])
    (tmp_path / "u.stl").write_bytes(stl(np.concatenate(corners), triangles))
    shape = Shape(0, "u", "mesh", (1.0, 1.0, 1.0), np.eye(4), "u.stl", tmp_path / "u.stl")
    low, high = np.array([-40.0, -30.0, -60.0]), np.array([40.0, 30.0, 60.0])
    exact = Exact([shape], [Obstacle(low, high)])
    T = np.tile(np.eye(4), (60, 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(rng.normal(size=(60, 3)) * 0.15).as_matrix()
    T[:, :3, 3] = rng.normal(size=(60, 3)) * 20

    U = shifted((low + high) / 2)
    far = [[apart(one @ shifted(middle), np.array(size), U, high - low) for size, middle in parts] for one in T]
    truth = np.min(far, axis=1)
    for margin in (0.5, 10.0, 30.0):
        near = exact.near((0, None, 0), [T[:, :3]], np.arange(60), np.full(60, margin))
        assert (near == (truth < margin)).all()
    assert 5 < (truth > 10).sum() < 55


def shifted(by):
    T = np.eye(4)
    T[:3, 3] = by
    return T
