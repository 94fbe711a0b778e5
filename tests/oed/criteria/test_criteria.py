"""The table of criteria: published definitions, and the laws that every row has to keep."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scored import drawn, value

from oed.criteria.criteria import CRITERIA, criterion_named, score

SEEDS = st.integers(0, 2**32 - 1)
GROWING = ("D", "A", "E", "V", "G")  # what one touch more never hurts, all touches together


def better(name, new, old):
    """How much better one value is than another, as a share."""
    return (new - old if CRITERIA[name].larger_is_better else old - new) / abs(old)


def test_the_indices_are_what_their_authors_wrote():
    rows, zone, _ = drawn(1)
    s = np.linalg.svd(rows, compute_uv=False)
    C = np.linalg.inv(rows.T @ rows)
    tip = [np.trace(J @ C @ J.T) for J in zone]

    published = {
        "O1": np.prod(s) ** (1 / 5) / np.sqrt(12),
        "O2": s[-1] / s[0],
        "O3": s[-1],
        "O4": s[-1] ** 2 / s[0],
        "O5": 1 / np.sum(1 / s),
        "D": np.linalg.det(rows.T @ rows / 12) ** (1 / 5),
        "A": np.trace(C),
        "E": 1 / np.linalg.norm(C, 2),
        "V": np.mean(tip),
        "G": np.max(tip),
    }

    assert {name: value(name, rows, zone) for name in CRITERIA} == pytest.approx(published, rel=1e-9)


@pytest.mark.parametrize("name", CRITERIA)
@given(seed=SEEDS)
def test_the_order_of_touches_does_not_matter(name, seed):
    rows, zone, rng = drawn(seed)

    assert value(name, rng.permutation(rows), zone) == pytest.approx(value(name, rows, zone), rel=1e-6)


@pytest.mark.parametrize("name", CRITERIA)
@given(seed=SEEDS)
def test_doubling_the_information_scales_the_value_by_its_degree(name, seed):
    rows, zone, _ = drawn(seed)

    doubled = float(score(name, 2 * rows.T @ rows, len(rows), zone))

    assert doubled == pytest.approx(2 ** CRITERIA[name].degree * value(name, rows, zone), rel=1e-9)


@pytest.mark.parametrize("name", GROWING)
@given(seed=SEEDS)
def test_one_touch_more_never_hurts(name, seed):
    rows, zone, rng = drawn(seed)
    more = np.vstack([rows, rng.normal(size=rows.shape[1])])

    assert better(name, value(name, more, zone, touches=1), value(name, rows, zone, touches=1)) > -1e-9


@pytest.mark.parametrize("name", CRITERIA)
@given(seed=SEEDS)
def test_a_rotation_of_the_parameters_changes_nothing(name, seed):
    rows, zone, rng = drawn(seed)
    R, _ = np.linalg.qr(rng.normal(size=(5, 5)))

    assert value(name, rows @ R, zone @ R) == pytest.approx(value(name, rows, zone), rel=1e-5)


@pytest.mark.parametrize("name", CRITERIA)
@given(seed=SEEDS)
def test_a_change_of_units_or_base_frame_keeps_what_the_table_promises(name, seed):
    rows, zone, rng = drawn(seed)
    other = rng.normal(size=rows.shape)
    T = rng.normal(size=(5, 5)) + 3 * np.eye(5)

    ratio = value(name, rows, zone) / value(name, other, zone)
    moved = value(name, rows @ T, zone @ T) / value(name, other @ T, zone @ T)

    if CRITERIA[name].keeps in ("ranking", "value"):
        assert moved == pytest.approx(ratio, rel=1e-5)
    if CRITERIA[name].keeps == "value":
        assert value(name, rows @ T, zone @ T) == pytest.approx(value(name, rows, zone), rel=1e-5)


@pytest.mark.parametrize("name", [c.name for c in CRITERIA.values() if c.keeps == "rotation"])
def test_an_index_that_promises_nothing_about_units_does_depend_on_them(name):
    rows, zone, _ = drawn(2)
    unit = np.diag([0.001, 1, 1, 1, 1])

    assert abs(value(name, rows @ unit, zone) / value(name, rows, zone) - 1) > 0.01


@pytest.mark.parametrize("name", CRITERIA)
def test_a_batch_of_sets_is_scored_like_each_of_them(name):
    sets = [drawn(seed)[0] for seed in range(6)]
    zone = drawn(9)[1]
    M = np.array([rows.T @ rows for rows in sets])

    batch = score(name, M.reshape(2, 3, 5, 5), 12, zone)

    assert batch.shape == (2, 3)
    assert batch.ravel() == pytest.approx([value(name, rows, zone) for rows in sets])


@pytest.mark.parametrize("name", CRITERIA)
def test_touches_that_do_not_determine_everything_are_worth_nothing(name):
    rows, zone, _ = drawn(3)
    rows[:, 2] = 0

    worst = value(name, rows, zone)

    assert worst == pytest.approx(0, abs=1e-6) if CRITERIA[name].larger_is_better else worst > 1e12


def test_every_row_says_what_it_means_and_where_it_comes_from():
    for criterion in CRITERIA.values():
        assert len(criterion.meaning) > 15
        assert criterion.source[-4:].isdigit()


def test_an_unknown_criterion_gets_the_list():
    with pytest.raises(ValueError, match=r"criterion 'X' is unknown; choose one of O1, O2, .*, G"):
        criterion_named("X")
