"""Plans: what they promise, and what they say when they cannot."""

from dataclasses import replace

import numpy as np
import pytest

import identify
from identify.model.files import InputError
from identify.model.io.tables import plan_text
from identify.model.zone import zone_poses
from identify.uncertainty.information import built_knowledge, drawn
from oed.criteria.criteria import CRITERIA
from oed.planning.candidate_set import offer
from oed.planning.plan import plan, summary
from oed.planning.strategies import STRATEGIES
from oed.planning.visitable import Best, linked, measured, robust
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


@pytest.fixture(params=STRATEGIES)
def result(request, results):
    return results[request.param]


@pytest.fixture(scope="module")
def offered(arc_welder):
    return offer(arc_welder, np.random.default_rng(3), count=OFFER)


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
def test_the_optimal_plan_promises_three_quarters_of_the_error_of_others(results, strategy):
    assert results["optimal"].promise.rms_mm < 0.75 * results[strategy].promise.rms_mm


def test_what_is_promised_is_delivered(arc_welder, optimal):
    """Thirty robots near nominal, touched and identified as in life: their tip errors at new poses of the zone."""
    q = zone_poses(arc_welder, poses=100, rng=np.random.default_rng(77))
    squares = []

    for seed in range(30):
        rng = np.random.default_rng(seed)
        truth = draw_truth(arc_welder, rng, scale=0.1, jig=True)
        touches = touch_batch(arc_welder, truth, optimal.plan, rng)
        found = identify.calibrate(arc_welder, touches.take(np.array(touches.status) == "hit"), folds=0, loss="linear")
        tips = [arc_welder.kinematics.tip(q, theta)[0] for theta in (truth.theta, found.theta)]
        squares.append(((tips[0] - tips[1]) ** 2).sum(axis=1))

    assert np.sqrt(np.mean(squares)) == pytest.approx(optimal.promise.rms_mm, rel=0.15)
    assert np.percentile(np.sqrt(squares), 95) == pytest.approx(optimal.promise.p95_mm, rel=0.2)


def test_the_same_seed_gives_the_same_plan(arc_welder, optimal):
    again = planned(arc_welder)

    assert plan_text(again.plan, arc_welder.robot) == plan_text(optimal.plan, arc_welder.robot)


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


def test_the_curve_passes_through_the_plan_and_falls(optimal):
    counts, errors = zip(*optimal.curve, strict=True)

    assert dict(optimal.curve)[N] == pytest.approx(optimal.promise.p95_mm)
    assert list(counts) == sorted(counts)
    assert (np.diff(errors) < 0).all()


def test_progress_goes_from_nothing_to_all(arc_welder):
    heard = []

    planned(arc_welder, strategy="random", progress=lambda what, share: heard.append((what, share)))

    shares = [share for _, share in heard]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)


def test_postures_with_the_elbow_bent_past_the_shoulder_are_left_out(offered):
    """Forearm or torch would have to pass through the shoulder to unbend it: nothing leads there from the others."""
    bent = offered.found.q[:, 2] > np.radians(108)

    joined = linked(Best(offered, N, "V"))

    assert bent.sum() > 20
    assert joined[bent].mean() < 0.1
    assert joined[~bent].mean() > 0.85


def test_touches_chosen_by_any_criterion_are_hardly_beaten_by_those_of_another(offered):
    """Chosen alike, from touches on offer, by the criterion without what was known before."""
    everything = np.ones(len(offered.found), dtype=bool)
    best = {name: Best(offered, N, name)(everything, None) for name in CRITERIA}
    M = {name: offered.known.precision + offered.rows[i].T @ offered.rows[i] for name, i in best.items()}

    for name in CRITERIA:
        criterion = measured(name, offered)
        worth = {other: criterion.phi(M[other]) for other in CRITERIA}
        assert worth[name] > 0.95 * max(worth.values()), name


def test_a_criterion_that_is_not_smooth_plans_too(arc_welder):
    result = planned(arc_welder, criterion="O4", count=300)

    assert len(result) == N
    assert result.manifold is None


def test_touches_after_a_calibration_add_to_what_is_known(arc_welder, optimal):
    rng = np.random.default_rng(1)
    truth = draw_truth(arc_welder, rng, scale=0.2)
    first = identify.calibrate(arc_welder, touch_batch(arc_welder, truth, optimal.plan, rng), folds=0, loss="linear")

    more = planned(arc_welder, 8, after=first)

    tip, _ = arc_welder.kinematics.tip(more.plan.q, first.theta)
    height = [
        arc_welder.jig.by_name[f].normal @ p - arc_welder.jig.by_name[f].offset
        for f, p in zip(more.plan.face, tip, strict=True)
    ]
    assert np.abs(height).max() <= arc_welder.wire.radius + 1e-3  # on the faces by the calibrated robot
    assert len(more) == 8
    assert more.promise.p95_mm < optimal.promise.p95_mm


def test_a_robust_plan_suits_the_worst_of_the_drawn_robots_better(offered):
    models = np.vstack([offered.known.theta, drawn(offered.known, 5, np.random.default_rng(8))])
    rows = [offered.rows_at(theta) for theta in models]
    B = [measured("V", offered, offered.known.tip_rows(offered.zone, theta)).W for theta in models]
    everything = np.ones(len(offered.found), dtype=bool)

    def worst(index):
        return max(np.trace(b @ offered.known.covariance(F[index])) for b, F in zip(B, rows, strict=True))

    chosen = {flag: robust(offered, N, "V", models, flag)(everything, None) for flag in (True, False)}
    nominal = robust(offered, N, "V", offered.known.theta[None], False)(everything, None)

    assert worst(chosen[True]) < worst(nominal)
    assert worst(chosen[True]) < worst(chosen[False])


def test_a_robust_plan_can_be_made(arc_welder):
    assert len(planned(arc_welder, robust=2, count=400)) == N


def test_a_plan_for_robots_as_built_sees_what_the_drawing_hides(arc_welder, offered):
    """Two axes are parallel on the drawing; two more parameters can be told apart where they are not."""
    built = built_knowledge(arc_welder)

    assert len(offered.drawing.names) == 25
    assert len(built.names) == 27  # as of any arm whose six axes stand anyhow
    assert set(np.sign(built.built - arc_welder.theta)) <= {-1.0, 1.0}
    np.testing.assert_allclose(np.abs(built.built - arc_welder.theta), arc_welder.prior)


def test_a_target_is_met_with_few_touches(arc_welder):
    result = planned(arc_welder, None, target=0.2, count=400)

    assert result.promise.p95_mm <= 0.2
    assert 25 <= len(result) < 45


def test_a_target_that_no_number_of_touches_meets_gets_the_floor(arc_welder):
    with pytest.raises(InputError, match=r"no number of touches can promise it.*alone leaves 0\.0\d+ mm"):
        planned(arc_welder, None, target=0.02, count=400)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"n": 24}, "24 touches cannot determine the 25 identifiable parameters"),
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
    assert any("add a face that looks along" in sentence for sentence in result.unseen)
