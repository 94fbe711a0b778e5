"""Shapes are asked where capsules come near: they refuse less, and never too little."""

from dataclasses import replace

import pytest
from boxed_arm import bare
from meshed import box, collision, mesh, stl, written

from identify.model.urdf.chain import read_urdf
from probe.motion.bodies import notes
from probe.motion.clearance import CLEAR, MARGIN, Clearance

pytest.importorskip("coal")


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
    assert notes(cell.robot) == (
        "collision: the arm is judged by capsules around its shapes; to judge the shapes themselves: "
        "pip install 'touchcal[collision]' (Linux, macOS)",
    )


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
