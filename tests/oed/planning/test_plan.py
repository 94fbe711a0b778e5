"""Plans: what they promise, and what they say when they cannot."""

from dataclasses import replace

import numpy as np
import pytest
from misses import made

import identify
from identify.model.base_placement import parked
from identify.model.cell import Priors
from identify.model.files import InputError
from identify.model.io.tables import plan_text
from identify.model.measurement import rows
from identify.model.zone import zone_poses
from identify.uncertainty.unknowns import Unknowns
from oed.criteria.criteria import CRITERIA
from oed.planning.candidate_set import make_candidate_set
from oed.planning.plan import plan, summary
from oed.planning.strategies import STRATEGIES
from oed.planning.visitable import Best, linked, measured
from probe.motion.room import Room
from probe.virtual.batch import touch_batch
from probe.virtual.truth import draw_truth

OFFER = 1200  # touches on offer: fewer than a user gets, for speed
N = 30


def planned(cell, n=N, **options):
    return plan(cell, n, **{"rng": np.random.default_rng(3), "count": OFFER} | options)


@pytest.fixture(scope="module")
def results(arc_welder):
    """One plan by each strategy."""
    return {strategy: planned(arc_welder, strategy=strategy) for strategy in STRATEGIES}


@pytest.fixture(scope="module")
def optimal(results):
    return results["optimal"]


@pytest.fixture(scope="module")
def near(arc_welder):
    """A cell with a tenth of the tolerances, and a plan for it."""
    cell = replace(arc_welder, priors=Priors((1.0, 0.0035), (1.0, 0.0035), (0.3, 0.0017)))
    return cell, planned(cell)


@pytest.fixture(params=STRATEGIES)
def result(request, results):
    return results[request.param]


@pytest.fixture(scope="module")
def offered(arc_welder):
    return make_candidate_set(arc_welder, np.random.default_rng(3), count=OFFER)


def test_a_plan_touches_the_planes_of_its_faces(arc_welder, result):
    made, jig = result.plan, arc_welder.jig
    tip, R = arc_welder.kinematics.tip(made.q, arc_welder.theta)

    faces = [jig.by_name[name] for name in made.face]
    height = np.array([f.normal @ t - f.offset for f, t in zip(faces, tip, strict=True)])
    cosine = np.array([-f.normal @ r[:, 2] for f, r in zip(faces, R, strict=True)])
    assert height == pytest.approx(arc_welder.wire.radius * np.sqrt(np.maximum(1 - cosine**2, 0)), abs=1e-3)  # [mm]
    assert (cosine >= np.cos(arc_welder.touch.max_tilt) - 1e-9).all()
    on = np.array([f.fractions(p) for f, p in zip(faces, made.point, strict=True)])
    assert ((on >= 0) & (on <= 1)).all()


def test_a_plan_stays_within_the_joint_limits(arc_welder, result):
    robot = arc_welder.robot

    for q in (result.plan.q, result.plan.approach):
        assert ((q >= robot.lower) & (q <= robot.upper)).all()


def test_the_tip_stays_out_of_the_jig_on_the_way_from_touch_to_touch(arc_welder, result):
    """Looked at every 2 % of the way, by the boxes of the jig alone."""
    path = np.concatenate([result.plan.way(i) for i in range(len(result))])
    start, end = path[:-1], path[1:]
    s = np.linspace(0, 1, 51)[:, None, None]

    tip = arc_welder.kinematics.tip((start + s * (end - start)).reshape(-1, start.shape[1]), arc_welder.theta)[0]

    for box in arc_welder.jig.boxes:
        assert not ((tip > box.lower) & (tip < box.upper)).all(axis=1).any()
    assert not any("way" in note for note in result.notes)


@pytest.mark.parametrize("strategy", ["even", "random"])
def test_the_optimal_plan_leaves_three_quarters_of_the_error_of_others(results, strategy):
    deviation = {name: np.sqrt(result.indices["V"]) for name, result in results.items()}

    assert deviation["optimal"] < 0.75 * deviation[strategy]
    assert results["optimal"].promise.p95_mm < results[strategy].promise.p95_mm


def test_what_is_promised_is_delivered(near):
    """Robots and jigs drawn from the priors, touched as in life; estimates by the linear model of the plan."""
    cell, result = near
    q = zone_poses(cell, poses=100, rng=np.random.default_rng(77))
    delivered = []

    for seed in range(40):
        rng = np.random.default_rng(seed)
        truth = draw_truth(cell, rng, jig=True)
        touches = touch_batch(cell, truth, result.plan, rng)
        x = most_probable(cell, touches.take(np.array(touches.status) == "hit"))
        tips = [cell.kinematics.tip(q, theta)[0] for theta in (truth.theta, Unknowns.of(cell).theta(x))]
        delivered.append(np.linalg.norm(tips[0] - tips[1], axis=1))

    errors = np.percentile(delivered, 95, axis=1)
    assert (errors <= result.promise.p95_mm).mean() >= 0.9  # 95 of 100 are promised, of 40 robots
    assert result.promise.p95_mm < 2.6 * np.median(errors)


def most_probable(cell, touches):
    """Gauss-Newton on all unknowns with their priors."""
    unknowns, equations = Unknowns.of(cell), rows(cell.wire, [touches])
    x = np.zeros(len(unknowns))
    for _ in range(4):
        r, J = unknowns.linearize(x, equations)
        A = np.vstack([J / equations.sigma[:, None], np.eye(len(x))])
        x = x - np.linalg.lstsq(A, np.concatenate([r / equations.sigma, x]), rcond=None)[0]
    return x


def test_fewer_touches_than_parameters_are_a_plan_too_and_promise_less(near):
    few = planned(near[0], 8, count=400)

    assert len(few) == 8
    assert near[1].promise.p95_mm < few.promise.p95_mm < np.inf
    assert "V" in few.indices
    assert "A" not in few.indices  # so few touches alone determine nothing


def test_the_same_seed_gives_the_same_plan(arc_welder, optimal):
    again = planned(arc_welder)

    assert plan_text(again.plan, arc_welder.robot) == plan_text(optimal.plan, arc_welder.robot)


def test_a_result_shows_itself_in_a_few_lines(optimal):
    shown = repr(optimal)

    assert f"{len(optimal)} touches" in shown
    assert f"{optimal.promise.p95_mm:.3f} mm" in shown
    assert len(shown) < 4 * 80


def test_a_plan_that_tells_more_than_any_touches_on_offer_is_not_a_share_of_them(optimal):
    shown = repr(replace(optimal, efficiency=1.004))

    assert "better than any choice on offer" in shown
    assert "100.4" not in shown


def test_the_summary_has_what_the_command_promises(optimal):
    told = summary(optimal)

    assert {
        "touches",
        "criterion",
        "indices",
        "efficiency",
        "efficiency_covers",
        "promise",
        "minutes",
        "unseen",
    } <= set(told)
    assert told["touches"] == N
    assert set(told["indices"]) == set(CRITERIA)
    assert told["efficiency_covers"] in ("candidates", "manifold")
    assert 0 < told["manifold"] < told["efficiency"] < 1.1
    assert N * 5 / 60 < told["minutes"] < N * 20 / 60


def test_the_curve_passes_through_the_plan_and_falls(near, optimal):
    for result in (near[1], optimal):
        counts, errors = zip(*result.curve, strict=True)

        assert dict(result.curve)[N] == pytest.approx(result.promise.p95_mm)
        assert list(counts) == sorted(counts)
        assert (np.diff(errors) < (0.0 if result is near[1] else 1e-3 * errors[0])).all()  # some robots miss them all


def test_tight_tolerances_break_no_plan(arc_welder, near):
    tight = planned(replace(arc_welder, priors=Priors((0.05, 0.00035), (0.05, 0.00035), (0.015, 0.00017))))

    assert (np.diff([error for _, error in tight.curve]) <= 0).all()
    assert tight.promise.p95_mm < near[1].promise.p95_mm
    assert 0.9 < tight.efficiency <= 1 + 1e-6


def test_a_plan_says_how_many_touches_will_miss_and_promises_less_for_it(near, optimal):
    searches = next(note for note in optimal.notes if "miss (" in note)

    share = float(searches.split("(")[1].split(" %")[0])
    assert 20 < share < 60  # robots may be 50 mm off, and searches begin 25 mm before their faces
    assert "begin in contact or behind their face" in searches
    assert optimal.promise.p95_mm > 20 * near[1].promise.p95_mm
    few = [float(note.split("miss (")[1].split(" %")[0]) for note in near[1].notes if "miss (" in note]
    assert sum(few) < 3


def test_progress_goes_from_nothing_to_all(arc_welder):
    heard = []

    planned(arc_welder, strategy="random", progress=lambda what, share: heard.append((what, share)))

    shares = [share for _, share in heard]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)


def test_the_robot_gets_from_where_it_is_parked_to_each_touch_in_turn(near):
    cell, result = near
    made = result.plan
    room = Room(cell, [*made.approach])
    at = parked(cell)
    for approach, via in zip(made.approach, made.via, strict=True):
        assert room.route(at, approach, [q for q in via if not np.isnan(q).any()])
        at = approach


def test_postures_with_the_elbow_bent_past_the_shoulder_are_left_out(offered):
    """Forearm or torch would have to pass through the shoulder to unbend it: nothing leads there from the others."""
    bent = offered.candidates.q[:, 2] > np.radians(108)

    joined, _ = linked(Best(offered, N, "V"))

    assert bent.sum() > 5
    assert joined[bent].mean() < 0.1
    assert joined[~bent].mean() > 0.85


def test_touches_chosen_by_any_criterion_are_hardly_beaten_by_those_of_another(offered):
    """Chosen alike, from the candidates, each in the coordinates of the criterion."""
    everything = np.ones(len(offered.candidates), dtype=bool)
    best = {name: Best(offered, N, name)(everything, None) for name in CRITERIA}

    for name in CRITERIA:
        criterion, coordinates = measured(name, offered), offered.coordinates(name)
        M = {other: coordinates.information(offered.rows[i] @ coordinates.basis) for other, i in best.items()}
        worth = {other: criterion.phi(M[other]) for other in CRITERIA}
        assert worth[name] > 0.95 * max(worth.values()), name


def test_a_criterion_that_is_not_smooth_plans_too(arc_welder):
    result = planned(arc_welder, criterion="O4", count=300)

    assert len(result) == N
    assert result.manifold is None


def test_touches_after_a_calibration_add_to_what_is_known(arc_welder, optimal):
    rng = np.random.default_rng(1)
    truth = draw_truth(arc_welder, rng, scale=0.2)
    first = identify.calibrate(
        arc_welder, touch_batch(arc_welder, truth, optimal.plan, rng), folds=0, loss="linear", errors="cell"
    )

    more = planned(arc_welder, 8, after=first)

    tip, _ = arc_welder.kinematics.tip(more.plan.q, first.theta)
    height = [
        arc_welder.jig.by_name[f].normal @ p - arc_welder.jig.by_name[f].offset
        for f, p in zip(more.plan.face, tip, strict=True)
    ]
    assert np.abs(height).max() <= arc_welder.wire.radius + 1e-3  # on the faces by the calibrated robot
    assert len(more) == 8
    assert more.promise.p95_mm < optimal.promise.p95_mm


def test_a_target_is_met_with_few_touches(near):
    result = planned(near[0], None, target=0.2, count=400)

    assert result.promise.p95_mm <= 0.2
    assert 15 <= len(result) < 45


def test_a_target_that_no_number_of_touches_meets_gets_the_floor(near):
    with pytest.raises(InputError, match=r"no number of touches can promise it.*alone leaves 0\.0\d+ mm"):
        planned(near[0], None, target=0.02, count=400)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"n": 0}, "0 touches are asked for, expected a number above 0"),
        ({"n": 101, "count": 100}, "only 100 were found"),
        ({"criterion": "O9"}, "criterion 'O9' is not known.*choose one of O1"),
        ({"strategy": "evn"}, "did you mean 'even'"),
        ({"target": 0.1, "n": 30}, "give one"),
        ({"target": -1.0, "n": None}, "above 0"),
    ],
)
def test_a_plan_that_cannot_be_says_why_in_a_sentence(arc_welder, options, sentence):
    with pytest.raises(InputError, match=sentence):
        planned(arc_welder, **options)


def test_a_cell_without_a_jig_gets_one_sentence(arc_welder):
    with pytest.raises(InputError, match="no jig to touch"):
        plan(replace(arc_welder, jig=None), n=30)


def test_a_jig_out_of_reach_gets_its_distance(arc_welder):
    far = replace(arc_welder, base=arc_welder.base + np.array([3000.0, 0, 0, 0, 0, 0]))

    with pytest.raises(InputError, match=r"\d+ mm"):
        planned(far)


def test_a_jig_of_one_face_leaves_directions_unseen_and_names_the_face_to_add(arc_welder):
    top = replace(arc_welder.jig, faces=(arc_welder.jig.by_name["top-high"],))

    result = planned(replace(arc_welder, jig=top), strategy="even", count=400)

    assert any("base.x" in sentence or "base.y" in sentence for sentence in result.unseen)
    assert any("add a face whose normal points along" in sentence for sentence in result.unseen)


def test_a_plan_keeps_its_promise_on_robots_that_miss_some_of_its_touches(near):
    """Followed along the search lines by the simulator of the studies; far fewer robots than the benchmark has."""
    cell, result = near

    few = made(cell, result.plan, 24)
    even = made(cell, planned(cell, 60, strategy="even").plan, 24)

    assert np.median(few.rms) < np.median(even.rms)
    assert (few.p95 <= result.promise.p95_mm).mean() >= 0.85  # of 24 robots; 0.95 are promised
    assert (~few.hit).mean() < 0.03
