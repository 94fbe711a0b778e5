"""How late a latch comes, from touches at two speeds that scatter as real ones do."""

from dataclasses import dataclass

import numpy as np
import pytest
from virtual_support import make_plan

from identify.model.cell import Cell
from identify.model.touch import Plan
from oed.cli.run import FASTER
from probe.motion.joint_path import Geometry
from probe.motion.settings import Settings
from probe.runs.delay import estimate_delay, without_delay
from probe.runs.records import Reading, Result

SIGMA = 0.05  # [mm] of one touch
SERVO = 0.001  # [s]
ROUNDS = 25


@dataclass(frozen=True)
class Search:
    """A touch at 1 mm/s."""

    name: str
    face: str
    contact: np.ndarray
    velocity: np.ndarray
    closing: float  # [mm/s], along the normal


@pytest.fixture(scope="module")
def plan(arc_welder: Cell) -> Plan:
    return make_plan(arc_welder, 100)


@pytest.fixture(scope="module")
def searches(arc_welder: Cell, plan: Plan) -> list[Search]:
    geometry, found = Geometry(arc_welder, Settings()), []
    assert arc_welder.jig is not None
    for i, name in enumerate(plan.ids):
        target = geometry.target(plan, i, arc_welder.jig)
        v = geometry.velocity(target.approach, target.end, geometry.search_rate(target, 1.0))
        ahead, behind = geometry.tip(np.stack([target.contact + 1e-3 * v, target.contact - 1e-3 * v]))
        closing = -float(target.face.normal @ (ahead - behind)) / 2e-3
        found.append(Search(name, target.face.name, target.contact, v, closing))
    return found


def touched(searches: list[Search], slow: float, delay: float, rng: np.random.Generator) -> list[Result]:
    """Two latches of each touch: where the contact closed, scattered, and late by the delay and up to a servo step."""

    def latched(search: Search, speed: float) -> Reading:
        scatter = SIGMA * rng.standard_normal() / (search.closing * speed)  # [s]
        v = speed * search.velocity
        return Reading(search.contact + (delay + SERVO * rng.uniform() - scatter) * v, v)

    return [Result(s.name, s.face, "hit", latched(s, slow), latched(s, FASTER * slow)) for s in searches]


@pytest.mark.parametrize("slow", [5.0, 10.0])
@pytest.mark.parametrize("delay", [0.0, 0.002, 0.01, 0.03])
def test_what_a_delay_adds_to_touches_is_taken_out_to_five_micrometres(
    arc_welder: Cell, searches: list[Search], rng: np.random.Generator, delay: float, slow: float
) -> None:
    left, told = [], []
    for _ in range(ROUNDS):
        found = estimate_delay(touched(searches, slow, delay, rng), arc_welder)
        left.append((found.seconds - delay - SERVO / 2) * slow)  # [mm]: half a servo step is late, too
        told.append(found.sigma * slow)

    assert np.abs(left).max() < 0.005
    assert np.std(left) == pytest.approx(np.mean(told), rel=0.5)  # and it is known how good that is


def test_touches_are_set_back_to_where_the_contact_closed(
    arc_welder: Cell, plan: Plan, searches: list[Search], rng: np.random.Generator
) -> None:
    results = touched(searches, 10.0, 0.02, rng)

    corrected = without_delay(results, arc_welder, 0.0205)

    tips = arc_welder.kinematics.tip(np.concatenate([corrected.q, plan.q]), arc_welder.theta)[0].reshape(2, -1, 3)
    off = np.einsum("ij,ij->i", tips[0] - tips[1], corrected.normal)
    assert abs(off.mean()) < 3 * SIGMA / np.sqrt(len(off))
    assert off.std() == pytest.approx(SIGMA, rel=0.3)
