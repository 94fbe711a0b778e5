"""The smallest number of touches for a target, on promises whose number is known by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from identify.model.files import InputError
from oed.planning.curve import STEPS, curve, smallest

FACES = (SimpleNamespace(tolerance=0.02), SimpleNamespace(tolerance=0.05))


class Touches:
    """So many touches of a jig."""

    faces = FACES

    def __init__(self, n):
        self.n = n

    def __len__(self):
        return self.n


class Offer:
    """Promises 1 mm over the root of the number of touches, beside a floor."""

    candidates = range(10_000)

    def __init__(self, floor=0.0, missing=0.0):
        self.floor, self.missing = floor, missing

    def promise(self, touches, times=1.0):
        return SimpleNamespace(p95_mm=float(np.hypot(self.floor, 1 / np.sqrt(len(touches) * times))))

    def searches(self, touches):
        return SimpleNamespace(missing=np.full(len(touches), self.missing))


@pytest.mark.parametrize("target", [0.05, 0.1, 0.11, 0.2, 0.9])
def test_the_smallest_number_is_the_one_of_the_closed_form(target):
    n = smallest(Offer(), target, Touches)

    assert n == int(np.ceil(1 / target**2 - 1e-9))


def test_the_curve_is_that_of_the_offer_and_falls():
    points = curve(Offer(0.02), Touches(40), Touches)

    assert len(points) == len(STEPS)
    for n, error in points:
        assert error == pytest.approx(np.hypot(0.02, 1 / np.sqrt(n)), rel=0.02)
    assert [error for _, error in points] == sorted((error for _, error in points), reverse=True)


def test_the_curve_is_level_where_draws_scatter_upwards_and_passes_through_the_plan():
    offer = Offer(0.02)
    usual, scatter = offer.promise, iter([0.0, 3e-3, 0.0, 3e-3, 0.0, 2e-2, 0.0, 4e-3, 1e-2])
    offer.promise = lambda touches, times: SimpleNamespace(p95_mm=usual(touches, times).p95_mm + next(scatter))

    points = curve(offer, Touches(40), Touches)

    assert [error for _, error in points] == sorted((error for _, error in points), reverse=True)
    assert dict(points)[40] == pytest.approx(usual(Touches(40)).p95_mm + 3e-3)


@pytest.mark.parametrize(("planned", "numbers"), [(40, (20, 40, 60, 100)), (200, (100, 200)), (1, (1, 2))])
def test_where_robots_that_miss_decide_the_curve_is_of_a_set_of_each_number(planned, numbers):
    offer = Offer(missing=0.5)
    offer.promise = lambda touches, times=1.0: SimpleNamespace(p95_mm=1 / np.sqrt(len(touches)))  # repeats tell nothing

    points = curve(offer, Touches(planned), Touches)

    assert points == tuple((n, pytest.approx(1 / np.sqrt(n))) for n in numbers)


def test_a_target_below_the_floor_is_the_fault_of_the_jig():
    with pytest.raises(
        InputError, match=r"stand where they should to 0.05 mm \(1 sigma\), and that alone leaves 0.100 mm"
    ):
        smallest(Offer(0.1), 0.09, Touches)


def test_where_many_touches_miss_these_are_the_fault():
    with pytest.raises(InputError, match=r"About 30 % of the touches .* miss"):
        smallest(Offer(0.1, missing=0.3), 0.09, Touches)


def test_more_touches_than_anybody_makes_are_refused():
    with pytest.raises(InputError, match=r"even 1000 touches promise no better than 0\.032 mm"):
        smallest(Offer(), 0.02, Touches)
