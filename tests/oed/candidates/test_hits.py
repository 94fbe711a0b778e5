"""What a search meets, by robots that may be off: compared with searches followed on the virtual jig."""

from dataclasses import replace

import numpy as np
import pytest
from cells import cell_of
from meshed import box, stl

from identify.model.cell import DEG, Priors
from identify.model.frames import transform
from identify.model.shape import Shape
from oed.candidates.candidates import candidates
from oed.candidates.hits import Outcome
from oed.planning.candidate_set import plan_of
from probe.virtual.batch import touch_batch
from probe.virtual.truth import Truth


@pytest.fixture(scope="module")
def cell():
    rough = Priors((6.0, 1.0 * DEG), (6.0, 1.0 * DEG), (2.0, 0.6 * DEG))
    return replace(cell_of("arc-welder"), priors=rough)


@pytest.fixture(scope="module")
def some(cell):
    return candidates(cell, np.random.default_rng(2), 400, structured=0.0, share=0.0)


def drawn(cell, robots=24):
    return cell.spread * np.random.default_rng(8).standard_normal((robots, len(cell.theta)))


def test_searches_meet_what_they_meet_on_the_virtual_jig(cell, some):
    off = drawn(cell)

    outcomes = some.hits.outcomes(some.face, some.q, off)

    plan, rng = plan_of(some), np.random.default_rng(1)
    met = [touch_batch(cell, Truth(cell.theta + one), plan, rng, sigma=0.0) for one in off]
    hit = np.array([[status == "hit" for status in touches.status] for touches in met])
    assert 0.7 < hit.mean() < 0.95
    assert ((outcomes == Outcome.MEETS) == hit).mean() > 0.97  # the other robots' tips pass edges by a hair
    assert (outcomes == Outcome.MEETS).mean() == pytest.approx(hit.mean(), abs=0.01)


def test_the_share_of_robots_that_meet_a_touch_is_that_of_thousands_of_draws(cell, some):
    met = some.hits.outcomes(some.face, some.q, drawn(cell, 4000)) == Outcome.MEETS

    assert np.abs(some.hit - met.mean(axis=0)).max() < 0.06
    assert np.abs(some.hit - met.mean(axis=0)).mean() < 0.015
    assert some.hit.mean() == pytest.approx(met.mean(), abs=0.005)


def test_a_robot_as_drawn_meets_every_touch(cell, some):
    assert (some.hits.outcomes(some.face, some.q, np.zeros((1, len(cell.theta)))) == Outcome.MEETS).all()


@pytest.mark.parametrize(
    ("shift", "outcome"), [((0, 0, 200), Outcome.SHORT), ((0, 0, -200), Outcome.BEHIND), ((400, 0, 0), Outcome.SLIDES)]
)
def test_a_base_that_stands_elsewhere_makes_touches_from_above_miss(cell, some, shift, outcome):
    top = some.take(some.face == [f.name for f in some.faces].index("top-high"))
    off = np.zeros((1, len(cell.theta)))
    off[0, :3] = shift

    outcomes = some.hits.outcomes(top.face, top.q, off)

    assert len(top)
    assert (outcomes == outcome).all()


def test_a_search_beside_a_high_step_meets_it_first(cell, some):
    low = some.take(some.face == [f.name for f in some.faces].index("front-low"))
    off = np.zeros((1, len(cell.theta)))
    off[0, 1:3] = -20.0, 110.0  # over the edge of the low step, before the high one

    outcomes = some.hits.outcomes(low.face, low.q, off)

    assert set(outcomes.ravel().tolist()) <= {Outcome.SLIDES, Outcome.SHORT, Outcome.OTHER}


def test_faces_are_asked_for_sure_touches_where_they_have_them(cell, some):
    share = np.where(some.face == some.face[0], np.linspace(0.8, 1.0, len(some)), 0.5)

    sure = some.hits.requiring(some.face, share).sure(some.face, share)

    assert share[sure & (some.face == some.face[0])].min() >= 0.97
    assert sure[some.face != some.face[0]].all()  # nothing is sure there


@pytest.mark.parametrize("kind", ["cylinder", "mesh", "box"])
def test_a_search_ends_at_an_obstacle_that_it_meets_first_in_both(cell, some, kind, tmp_path):
    top = [f.name for f in some.faces].index("top-high")
    touches, face = some.take(some.face == top), some.faces[top]
    path = tmp_path / "box.stl"
    path.write_bytes(stl(*box((1, 1, 1))))
    low = face.point(np.array(0.5), np.array(0.5)) + np.array([0.0, 0.0, 4.0])  # over the middle of the face
    width = 0.5 * face.size.min()
    size = {"cylinder": (width / 2, 8.0), "box": (width, width, 8.0), "mesh": (width, width, 8.0)}[kind]
    solid = Shape(0, "lid", kind, size, transform(np.array([*low, 0.3, 0.0, 0.0])), "box.stl", path)
    covered = replace(cell, obstacles=(solid,))
    hits = replace(some.hits, cell=covered)
    off = drawn(cell, 8)

    outcomes = hits.outcomes(touches.face, touches.q, off)

    plan, rng = plan_of(touches), np.random.default_rng(1)
    met = [touch_batch(covered, Truth(cell.theta + one), plan, rng, sigma=0.0) for one in off]
    hit = np.array([[status == "hit" for status in batch.status] for batch in met])
    before = some.hits.outcomes(touches.face, touches.q, off) == Outcome.MEETS
    assert 0.05 < (before & (outcomes == Outcome.OTHER)).mean() < 0.9
    assert ((outcomes == Outcome.MEETS) == hit).mean() > 0.96
