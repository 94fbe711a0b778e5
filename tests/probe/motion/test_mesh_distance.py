"""Meshes of an arm among the boxes of a jig: distances by another method, and what capsules around them would say."""

from dataclasses import replace

import numpy as np
import pytest
from boxed_arm import bare
from meshed import LINKS, box, stl
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from identify.model.joint import Capsule
from identify.model.shape import Shape
from oed.candidates.candidates import candidates
from probe.motion.clearance import CLEAR, MARGIN, Clearance
from probe.motion.edges import FINE, Edges
from probe.motion.obstacles import Obstacle

pytest.importorskip("coal")
from probe.motion.mesh_distance import Exact

BOXES = {name: (1000 * np.array(size), 1000 * np.array(middle)) for name, _, size, middle in LINKS}


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


def test_a_mesh_hits_where_the_thin_capsule_of_a_robot_file_does_not(cell, rng):
    thin = tuple(Capsule(s.link, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0) for s in cell.robot.shapes if s.link < 6)
    cell = bare(cell)
    q = rng.uniform(cell.robot.lower, cell.robot.upper, (200, 6))
    drawn = replace(cell, robot=replace(cell.robot, shapes=(), capsules=thin))
    free = Clearance(drawn, cell.theta).hits(q) == CLEAR

    hit = Clearance(cell, cell.theta).hits(q[free]) != CLEAR

    assert hit.sum() > 10


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
