"""Text and data of a page reach the reader as they are, and run nothing."""

import html
import json
import re

from hypothesis import given
from hypothesis import strategies as st

from identify.report.page import facts, folded, page, table, view


def test_data_of_a_scene_reads_back_from_the_page_whatever_it_is():
    scene = {"touches": ["</script>", "<!--<script>", "$title ${body}", "&amp;", '"', "\u2028\\"]}

    whole = page("title", "", scene)

    data = re.search(r'id="scene">(.*?)</script>', whole, flags=re.S)[1]
    assert json.loads(data) == scene
    assert "<!--" not in data


@given(st.text(max_size=20))
def test_cells_summaries_and_facts_are_escaped_and_read_back(text):
    cell = re.search(r"<td[^>]*>(.*?)</td>", table(["head"], [[text]]), flags=re.S)[1]
    summary = re.search(r"<summary>(.*?)</summary>", folded(text, ""), flags=re.S)[1]

    for part in (cell, summary, facts([(text, "value")]).split("<dt>")[1].split("</dt>")[0]):
        assert not re.search(r"[<>\"']", part)
        assert html.unescape(part) == html.unescape(html.escape(text))


def test_a_fact_without_a_value_is_left_out():
    assert facts([("robot", "arm"), ("serial number", "")]).count("<dt>") == 1


def test_a_view_without_touches_has_no_buttons_to_step():
    assert "<button" not in view({"touches": []})
    assert "identified robot" not in view({"touches": [{}], "left": 0})
    assert "5 more in the file" in view({"touches": [{"identified": []}], "left": 5})
