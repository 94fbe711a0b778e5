"""A touch counts only with all of its evidence."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from run_bench import USUAL, Bench

from identify.model.cell import Cell
from identify.model.touch import Plan
from probe.line.controller import Contact
from probe.motion.joint_path import Geometry
from probe.runs.acceptance import objection, unconfirmed
from probe.runs.records import APPROACH, CONTACT, RETRACTED, Intent, Observation

pytestmark = [pytest.mark.usefixtures("unsynced"), pytest.mark.xdist_group("runs bench")]


def wrong_latch(**change: object) -> Callable[[Bench], Callable[[str, np.ndarray], object]]:
    """A search whose answer is right but for something."""

    def order(bench: Bench) -> Callable[[str, np.ndarray], object]:
        def answer(kind: str, end: np.ndarray) -> object:
            start = bench.world.q
            hit = bench.world.first_contact(start, end)
            assert hit is not None
            q = start + hit * (end - start)
            bench.world.go(end, hit + 0.002)
            right = Contact(q, bench.world.q.copy(), bench.world.boot, bench.robot.last)
            return replace(right, **{key: f(right) if callable(f) else f for key, f in change.items()})

        return answer

    return order


@pytest.mark.parametrize(
    ("order", "reason"),
    [
        (wrong_latch(boot="OLD"), "another start"),
        (wrong_latch(sequence=lambda c: c.sequence - 1), "latch is of command"),
        (wrong_latch(q=lambda c: c.q + np.radians([0, 0, 0, 0, 0, 0.05])), "off the line"),
        (wrong_latch(q=lambda c: c.q + 5.0 * (c.q - c.stop)), "past the latch"),
        (wrong_latch(q=lambda c: c.stop + 2 * (c.stop - c.q)), "rest on the line of search behind the latch"),
        (wrong_latch(stop=lambda c: c.stop + np.radians([0, 0, 0, 0, 0.05, 0])), "rest on the line"),
    ],
)
def test_a_touch_that_breaks_a_rule_does_not_count_and_says_which(
    bench: Bench, order: Callable[[Bench], Callable[[str, np.ndarray], object]], reason: str
) -> None:
    bench.robot.fail = [None, order(bench)]

    finished = bench.run(replace(USUAL, stop_time=0.06))

    assert finished.hits == 8
    assert len(bench.reasons()) == 1
    assert reason in bench.reasons()[0]


def test_latches_outside_the_search_are_refused(cell: Cell, plan: Plan) -> None:
    geometry = Geometry(cell, USUAL)
    assert cell.jig is not None
    target = geometry.target(plan, 0, cell.jig)
    rate = geometry.search_rate(target, 10.0)
    intent = Intent("search", "t001", "B", 1, target.approach, target.end, target.approach, rate)

    def at(fraction: float) -> str:
        q = target.approach + fraction * (target.end - target.approach)
        return objection(Contact(q, q, "B", 1), intent, evidence(intent, q), geometry)

    assert at(0.4) == ""
    assert "expected between 0 and 1" in at(-0.01)
    assert "expected between 0 and 1" in at(1.01)


def evidence(search: Intent, contact: np.ndarray) -> dict[str, Observation]:
    """What is seen of a touch that counts, until the robot rests on it."""
    seen = [Observation(APPROACH, "B", search.start, False), Observation(CONTACT, "B", contact, True)]
    return {each.place: each for each in seen}


@pytest.mark.parametrize(
    ("place", "change", "reason"),
    [
        (APPROACH, {"closed": True}, "closed before the search"),
        (APPROACH, {"boot": "C"}, "nothing shows that the robot stood at the approach"),
        (APPROACH, {"q": np.ones(6)}, "did not stand at the approach"),
        (CONTACT, {"closed": False}, "did not last"),
        (CONTACT, {"boot": "C"}, "did not last"),
        (CONTACT, {"q": np.ones(6)}, "did not stay"),
        (RETRACTED, {"closed": True}, "still closed after the retract"),
        (RETRACTED, {"boot": "C"}, "still closed after the retract"),
    ],
)
def test_a_touch_counts_only_with_all_of_its_evidence(
    cell: Cell, plan: Plan, place: str, change: dict[str, object], reason: str
) -> None:
    geometry = Geometry(cell, USUAL)
    assert cell.jig is not None
    target = geometry.target(plan, 0, cell.jig)
    search = Intent(
        "search", "t001", "B", 1, target.approach, target.end, target.approach, geometry.search_rate(target, 10.0)
    )
    q = target.contact
    whole = evidence(search, q) | {RETRACTED: Observation(RETRACTED, "B", target.approach, False)}

    def judge(seen: dict[str, Observation]) -> str:
        return objection(Contact(q, q, "B", 1), search, seen, geometry) or unconfirmed(seen, search)

    assert judge(whole) == ""
    assert reason in judge(whole | {place: replace(whole[place], **change)})
    assert judge({key: value for key, value in whole.items() if key != place}) != ""


def test_a_contact_that_does_not_last_is_no_touch(bench: Bench) -> None:
    def glitch(kind: str, end: np.ndarray) -> object:
        start = bench.world.q
        bench.world.go(end, 0.2)
        return Contact(start + 0.199 * (end - start), bench.world.q.copy(), bench.world.boot, bench.robot.last)

    bench.robot.fail = [None, glitch]

    assert bench.run().hits == 8
    assert "did not last" in bench.reasons()[0]
