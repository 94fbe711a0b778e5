"""Unknowns: their rows against finite differences, and against faces and wires that really are elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from measured import touches_anywhere

from identify.model.cell import Priors
from identify.model.frames import rotation
from identify.model.measurement import rows as measured_rows
from identify.model.touch import Positions
from identify.uncertainty.unknowns import Unknowns, drift, stickout

TILT = 2e-3  # [rad]


@pytest.fixture(scope="module")
def cell(arc_welder):
    faces = tuple(replace(f, tilt=TILT if f.name == "front-low" else 0.0) for f in arc_welder.jig.faces)
    return replace(arc_welder, jig=replace(arc_welder.jig, faces=faces))


def test_all_that_has_a_tolerance_is_unknown_and_what_is_fixed_is_not(cell):
    unknowns = Unknowns.of(replace(cell, fixed=frozenset({"j2.a"})))

    assert len(unknowns) == 42 - 1 + len(cell.jig.faces) + 2
    assert "j2.a" not in unknowns.names
    assert {"base.x", "tool.rx", "face.top-low", "face.front-low.tilt_v"} < set(unknowns.names)
    assert (unknowns.precision == 1).all()


def test_what_is_to_be_fitted_has_no_prior(cell):
    unknowns = Unknowns.of(replace(cell, base=None))

    base = [f"base.{axis}" for axis in ("x", "y", "z", "rz", "ry", "rx")]
    assert np.flatnonzero(unknowns.precision == 0).tolist() == unknowns.index(base)


def test_lengths_that_are_exact_are_not_unknown(cell):
    exact = replace(cell, priors=Priors((10.0, 0.03), (10.0, 0.03), (0.0, 0.01)))

    assert not {"j1.d", "j2.a"} & set(Unknowns.of(exact).names)


def test_rows_are_derivatives_of_the_residuals_by_finite_differences(cell):
    further = (stickout("t16", 15), *drift(np.linspace(-0.5, 0.5, 30)))
    whole, touches = Unknowns.of(cell), touches_anywhere(cell)
    unknowns = replace(whole, shared=(*whole.shared, *further))
    rows = measured_rows(cell.wire, [touches.take(np.arange(15)), touches.take(np.arange(15, 30))])
    x, step = np.zeros(len(unknowns)), 1e-4

    J = unknowns.linearize(x, rows)[1]

    for k in range(len(x)):
        e = step * np.eye(len(x))[k]
        slope = (unknowns.linearize(x + e, rows)[0] - unknowns.linearize(x - e, rows)[0]) / (2 * step)
        assert J[:, k] == pytest.approx(slope, abs=2e-5 * max(1, np.abs(slope).max())), unknowns.names[k]
    assert unknowns.rows(rows) == pytest.approx(J / 0.05)


def test_a_face_that_stands_elsewhere_leaves_no_residual_at_its_offset_and_tilts(cell):
    """The plane of one face is moved and leaned; the unknowns of that face explain it."""
    unknowns, touches = Unknowns.of(cell), touches_anywhere(cell)
    offset, lean = 0.03, np.array([1e-4, -2e-4])  # [mm], [rad]
    face = cell.jig.by_name["front-low"]
    u, v = face.u / face.size[0], face.v / face.size[1]
    normal = face.normal - lean[0] * u - lean[1] * v
    middle = face.origin + (face.u + face.v) / 2 + offset * face.normal
    here = np.array(touches.face) == "front-low"
    moved = replace(
        touches,
        normal=np.where(here[:, None], normal, touches.normal),
        offset=np.where(here, normal @ middle, touches.offset),
    )
    x = np.zeros(len(unknowns))
    names = ["face.front-low", "face.front-low.tilt_u", "face.front-low.tilt_v"]
    x[unknowns.index(names)] = np.array([offset, *lean]) / unknowns.scale[unknowns.index(names)]
    pointed = replace(cell.wire, radius=0.0)

    explained = unknowns.linearize(x, measured_rows(pointed, [touches]))[0]

    actual = unknowns.linearize(np.zeros(len(x)), measured_rows(pointed, [moved]))[0]
    assert here.sum() > 1
    assert explained == pytest.approx(actual, abs=2e-4)  # [mm], squares of the lean


def test_a_wire_that_was_cut_is_a_longer_tool_from_then_on(cell):
    whole, touches = Unknowns.of(cell), touches_anywhere(cell)
    unknowns = replace(whole, shared=(*whole.shared, stickout("cut", len(touches))))
    rows = measured_rows(cell.wire, [touches, touches])
    length, theta = 0.4, cell.theta.copy()
    theta[-6:-3] += length * rotation(*theta[-3:])[:, 2]
    x = np.zeros(len(unknowns))
    k = unknowns.names.index("stickout.cut")
    x[k] = length / unknowns.scale[k]

    r = unknowns.linearize(x, rows)[0]

    longer = Unknowns.of(replace(cell, tool=theta[-6:])).linearize(np.zeros(len(x) - 1), rows)[0]
    same = unknowns.linearize(np.zeros(len(x)), rows)[0]
    assert r == pytest.approx(np.where(rows.owner >= len(touches), longer, same), abs=1e-9)


def test_positions_know_nothing_of_faces(cell):
    unknowns, q = Unknowns.of(cell), np.zeros((1, 6))
    rows = measured_rows(cell.wire, [Positions(("a",), q, np.zeros((1, 3)), np.ones(1))])

    F = unknowns.rows(rows)

    np.testing.assert_allclose(F, unknowns.tip_rows(q)[0])
    assert (F[:, unknowns.index(["face.top-low"])] == 0).all()
