"""What touches do not show is named, with the harm that it does; what they show is not."""

import pytest
from measured import touches_anywhere

from identify.model.measurement import rows as measured_rows
from identify.model.zone import zone_poses
from identify.uncertainty.coordinates import of_identifiable
from identify.uncertainty.information import prior_information
from identify.uncertainty.weak_directions import LISTED, limiting, unseen


@pytest.fixture(scope="module")
def prior(arc_welder):
    return prior_information(arc_welder)


@pytest.fixture(scope="module")
def zone(arc_welder):
    return zone_poses(arc_welder, poses=40)


@pytest.fixture(scope="module")
def pool(arc_welder, prior):
    """Rows of many touches by all unknowns, and by the identifiable ones."""
    F = prior.unknowns.rows(measured_rows(arc_welder.wire, [touches_anywhere(arc_welder, 400, 8)]))
    return F, F @ of_identifiable(prior).basis


def test_many_touches_all_over_leave_nothing_to_say(prior, pool, zone):
    assert unseen(of_identifiable(prior), pool[1], pool[1], zone) == ()


def test_few_touches_leave_directions_and_more_touches_are_the_cure(prior, pool, zone):
    sentences = unseen(of_identifiable(prior), pool[1], pool[1][:8], zone)

    assert len(sentences) == LISTED
    assert all(": these touches show it less well than the priors do; it leaves " in s for s in sentences)


def test_a_jig_that_cannot_show_a_direction_is_to_blame(prior, pool, zone):
    coordinates = of_identifiable(prior)
    name = coordinates.names.index("tool.z")
    blind = pool[1].copy()
    blind[:, name] = 0.0

    (sentence,) = unseen(coordinates, blind, blind, zone)

    assert sentence.startswith("tool.z")
    assert f"no {len(blind)} touches of this jig would show it better" in sentence
    assert "add a face whose normal points along" in sentence


def test_the_combination_that_limits_is_the_one_that_no_touch_has_seen(prior, pool, zone):
    name = prior.unknowns.names.index("tool.z")
    blind = pool[0].copy()
    blind[:, name] = 0.0

    sentence = limiting(prior.updated(blind), zone)

    assert "one combination of unknowns: tool.z" in sentence
    assert int(sentence.split(" %")[0]) > 90
