"""Programs of all makers against the live run, on the same virtual arm: three misses, and an input that sticks."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from maker_bench import MISSES, PULSES, RESOLUTION, STICKS, TOUCHES
from measured import poses_over_jig

from identify.estimation.calibrate import calibrate
from identify.model.io.tables import read_touches, touches_text
from probe.programs.makers import MAKERS

COARSE = ("yaskawa",)  # whose encoders count 0.002 degrees
JOINT_SEARCH = [name for name, maker in MAKERS.items() if not maker.straight]


@pytest.fixture(params=MAKERS)
def maker(request):
    return request.param


def test_every_touch_is_in_the_table_as_it_was_live_but_the_one_after_which_the_input_stuck(maker, made, live, bench):
    touches = made[maker].touches

    expected = [*live.status]
    expected[STICKS - 1] = "skipped"
    assert touches.ids == live.ids == bench.plan.ids
    assert touches.face == live.face
    assert list(touches.status) == expected
    assert [i + 1 for i, status in enumerate(live.status) if status == "miss"] == sorted(MISSES)
    assert made[maker].missing == ()


def test_the_joints_are_those_of_the_edge_to_the_resolution_of_the_controller(maker, made):
    touches, latches = made[maker].touches, made[maker].machine.latches

    contacts = [i for i in range(TOUCHES) if i + 1 not in MISSES]
    off = [
        np.abs(np.degrees(touches.q[i]) - latch).max()
        for i, latch in zip(contacts, latches, strict=True)
        if touches.status[i] == "hit"
    ]
    assert len(off) == TOUCHES - len(MISSES) - 1
    assert max(off) <= 0.5001 * RESOLUTION[maker]


@pytest.mark.parametrize("maker", JOINT_SEARCH)
def test_a_search_in_joint_space_gives_the_joints_of_the_live_run(maker, made, live):
    touches = made[maker].touches

    hits = np.array([a == b == "hit" for a, b in zip(touches.status, live.status, strict=True)])
    off = np.abs(np.degrees(touches.q[hits] - live.q[hits])).max(axis=1)
    assert np.quantile(off, 0.9) <= RESOLUTION[maker] + 2e-4  # and what the arm moves in a servo step
    assert off.max() <= RESOLUTION[maker] + 2e-3  # a search that ends at a joint limit ends that much before it
    np.testing.assert_allclose(touches.approach, live.approach, atol=1e-9)


def test_the_calibration_is_that_of_the_live_run(maker, made, live_theta, live_rms, bench):
    """Within 2 %: by what the program latched and, for a controller that knows whole pulses, on average over roundings.

    Pulses of 0.0005 to 0.0022 degrees move the contact by 0.0025 mm (RMS), beside a noise of 0.03 mm. That hides no
    information (0.3 % of the noise), but it is one more draw of noise: where the zero of an encoder lies within a pulse
    is an accident, and the zone RMS of this arm scatters over such zeros by 1.5 %, one sigma, as `scatter_of_zone_rms`
    computes it. The encoders know no more than whole pulses, so no program can do better: the mean square over zeros is
    held at 2 %, and any one draw at three of these sigma.
    """
    one, rounded = made[maker], zone_rms(bench, made[maker].touches)
    contacts = [i for i in range(TOUCHES) if i + 1 not in MISSES]
    latches = np.array(one.machine.latches)

    def rms_of(counts: np.ndarray) -> float:
        q = one.touches.q.copy()
        q[contacts] = np.radians(counts)
        return zone_rms(bench, replace(one.touches, q=q))

    assert live_rms < 0.1 * tip_rms(bench, bench.cell.theta)
    assert rms_of(latches) == pytest.approx(live_rms, rel=0.02)
    if maker not in COARSE:
        assert rounded == pytest.approx(live_rms, rel=0.02)
        return
    zeros = np.random.default_rng(7).uniform(-0.5, 0.5, (16, 6))
    draws = [rms_of((np.round(latches * PULSES + zero) - zero) / PULSES) for zero in zeros]
    sigma = scatter_of_zone_rms(bench, one.touches, live_theta)
    assert np.sqrt(np.mean(np.square(draws))) == pytest.approx(live_rms, rel=0.02)
    assert np.std(draws) == pytest.approx(sigma * live_rms, rel=0.5)  # 16 draws tell it to 18 %, one sigma
    assert rounded == pytest.approx(live_rms, rel=3 * sigma)


def scatter_of_zone_rms(bench, touches, theta) -> float:
    """By how much of itself whole pulses scatter the zone RMS of an arm identified as `theta`, to first order.

    A pulse of width w is a uniform error of variance w^2 / 12, which moves a contact along its normal by the Jacobian.
    The estimate moves by the gain K of least squares with priors, the squared tip error e' M e by 2 e' M K of that.
    """
    cell = bench.cell
    hit = np.array([status == "hit" for status in touches.status])
    q, normal = touches.q[hit], bench.plan.normal[hit]
    faces = sorted(set(bench.plan.face))
    on = np.array([[name == face for face in faces] for name in np.array(bench.plan.face)[hit]])
    tolerance = np.array([cell.the_jig.by_name[face].tolerance for face in faces])
    rows = np.einsum("mi,mip->mp", normal, cell.kinematics.tip_jacobian(q, theta)[1]) * cell.spread
    G = np.hstack([rows, on * tolerance]) / cell.touch.sigma
    K = np.linalg.solve(G.T @ G + np.eye(G.shape[1]), G.T / cell.touch.sigma)[: len(theta)] * cell.spread[:, None]
    moved = np.einsum("mi,mij->mj", normal, cell.kinematics.pose_jacobian(q, theta)[2][:, :3])
    variance = (moved**2 * np.radians(1 / PULSES) ** 2 / 12).sum(axis=1)
    A = cell.kinematics.tip_jacobian(poses_over_jig(cell, 300, np.random.default_rng(3)), theta)[1]
    M, e = np.einsum("mip,miq->pq", A, A) / len(A), theta - bench.truth.theta
    return float(np.sqrt((((e @ M @ K) ** 2) * variance).sum()) / (e @ M @ e))


def identified(bench, touches):
    """Parameters from all touches but the one that stuck."""
    table = touches.take(np.arange(TOUCHES) != STICKS - 1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "touches.csv"
        path.write_text(touches_text(table, bench.cell.robot))
        return calibrate(bench.cell, read_touches(path, bench.cell), folds=0, errors="cell").theta


def zone_rms(bench, touches) -> float:
    """RMS of the tip error [mm] in the zone after identification."""
    return tip_rms(bench, identified(bench, touches))


def tip_rms(bench, theta) -> float:
    """RMS of the tip error [mm] at poses of the zone."""
    q = poses_over_jig(bench.cell, 300, np.random.default_rng(3))
    a, b = (bench.cell.kinematics.tip(q, t)[0] for t in (theta, bench.truth.theta))
    return float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=1))))


@pytest.fixture(scope="module")
def live_theta(bench, live):
    return identified(bench, live)


@pytest.fixture(scope="module")
def live_rms(bench, live_theta) -> float:
    return tip_rms(bench, live_theta)
