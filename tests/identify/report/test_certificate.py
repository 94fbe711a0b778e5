"""The head and the foot of a report: everything that it was told, escaped, and nothing that it was not."""

from dataclasses import replace

import numpy as np
from measured import poses_over_jig, table_2, touches_at

from identify.report.certificate import Issue, foot, head


def test_the_head_states_who_when_and_what(found, arc_welder, rng):
    touches = touches_at(arc_welder, table_2(arc_welder), poses_over_jig(arc_welder, 2, rng), rng)
    timed = replace(touches, time=("2026-03-04T10:00:00", "2026-03-05T08:00:00"))

    cell = replace(found.cell, serial="R-17")
    text = head(replace(found, cell=cell), Issue("2026-03-06", "A. <Welder>", "9.9"), [timed])

    for words in ("2026-03-06", "A. &lt;Welder&gt;", "R-17", "2026-03-04 to 2026-03-05", "step-block", "touchcal 9.9"):
        assert words in text


def test_what_is_not_known_is_left_out(found):
    text = head(found, Issue(), [])

    assert "serial" not in text
    assert "operator" not in text
    assert "measured" not in text


def test_the_foot_lists_every_hash_and_has_lines_to_sign(found):
    text = foot(replace(found, inputs={"touches.csv": "ab" * 32}))

    assert "ab" * 32 in text
    assert text.count("<span>") == 3
    assert np.all([value in text for value in found.cell.sources.values()])
