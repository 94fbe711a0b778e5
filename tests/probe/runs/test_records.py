"""A result read from its row and its record is the one that was written, in the units of the model."""

from pathlib import Path

import numpy as np
import pytest
from sessions import small_plan, touch

from identify.model.cell import Cell
from probe.runs.journal import read_records
from probe.runs.records import result_of
from probe.runs.session import Session, journal_path

pytestmark = pytest.mark.usefixtures("unsynced")


@pytest.fixture
def written(tmp_path: Path, arc_welder: Cell) -> tuple[Session, list[dict[str, object]]]:
    path = tmp_path / "touches.csv"
    with Session(path, arc_welder, small_plan()) as session:
        touch(session, "a", note='a comma, and a "quote"')
        touch(session, "b", "miss")
    return session, [record for record in read_records(journal_path(path)).records if record["kind"] == "result"]


def test_a_result_comes_back_with_its_readings_and_its_words(written, arc_welder: Cell) -> None:
    session, records = written

    for record in records:
        was, now = session.results[record["id"]], result_of(record, arc_welder.robot)
        assert (now.id, now.face, now.status, now.note, now.temperature) == (
            was.id,
            was.face,
            was.status,
            was.note,
            was.temperature,
        )
        np.testing.assert_allclose(now.reading.velocity, was.reading.velocity, atol=1e-12)
        np.testing.assert_allclose(now.fast.q, was.fast.q, atol=1e-12)
    np.testing.assert_allclose(
        result_of(records[0], arc_welder.robot).reading.q, session.results["a"].reading.q, atol=1e-9
    )


def test_of_a_row_alone_the_rest_is_unknown(written, arc_welder: Cell) -> None:
    _, records = written

    result = result_of({"line": records[0]["line"]}, arc_welder.robot)

    assert result.fast is None
    assert np.isnan(result.reading.velocity).all()
    assert np.isfinite(result.reading.q).all()
