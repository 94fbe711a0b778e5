"""What a person reads fits the screen, at any width."""

import io
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oed.cli.options import print_json
from oed.cli.screen.fold import FoldedLines, folded, folding

WORDS = st.lists(st.text("abcxyz,;.", min_size=1, max_size=12), min_size=1, max_size=40)


@given(WORDS, st.integers(0, 6), st.integers(20, 120))
def test_no_line_runs_past_the_width_and_no_word_is_lost(words, indent, columns):
    line = " " * indent + " ".join(words) + "\n"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", str(columns))
        text = folded(line)

    assert text.split() == words
    assert max(map(len, text.splitlines())) <= columns
    assert text.endswith("\n")
    if len(line) <= columns:
        assert text == line


def test_lines_that_move_the_cursor_stay_as_they_are(monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")

    for line in ("\x1b[2K" + 50 * "a b ", "\r" + 50 * "a b "):
        assert folded(line) == line


def test_a_summary_for_machines_is_never_folded(monkeypatch):
    out = io.StringIO()
    monkeypatch.setenv("COLUMNS", "30")
    monkeypatch.setattr(sys, "stdout", FoldedLines(out))

    print_json({"note": 20 * "word "})

    assert 20 * "word " in out.getvalue()


def test_a_pipe_gets_lines_as_they_are(monkeypatch):
    out = io.StringIO()
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setattr(sys, "stdout", out)

    with folding():
        print(40 * "word ")

    assert out.getvalue() == 40 * "word " + "\n"


@pytest.mark.usefixtures("few_candidates")
def test_every_line_of_a_plan_fits(monkeypatch, touchcal, tmp_path):
    from identify.model.io.description import library

    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cell.yaml").write_text(library("cells")["arc-welder"].read_text())

    code, out, _ = touchcal("plan", "-n", "30", "--strategy", "even")

    assert code == 0
    assert max(map(len, out.splitlines())) <= 60
