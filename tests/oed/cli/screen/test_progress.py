"""A person sees how far work has come; a file, a pipe and a program see nothing of it."""

import io
import re
import sys

import pytest

from oed.cli.screen.progress import progress, remaining


class Terminal(io.StringIO):
    def isatty(self):
        return True


def shown(monkeypatch, **environment):
    """What a terminal of 60 columns gets."""
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    for name, value in ({"TERM": "xterm-256color", "COLUMNS": "60"} | environment).items():
        monkeypatch.setenv(name, value)
    with progress(True, "identifying") as update:
        update("choosing touches", 0.5)
        update("choosing touches", 0.9)
    return screen.getvalue()


@pytest.mark.parametrize(
    ("seconds", "share", "text"),
    [(10, 0.5, "10 s left"), (60, 0.25, "3 min left"), (1, 0.01, ""), (30, 1.0, ""), (0.0, 0.0, "")],
)
def test_the_time_that_remains_is_the_rest_at_the_pace_so_far(seconds, share, text):
    assert remaining(seconds, share) == text


def test_a_terminal_shows_work_and_time_left_within_its_width(monkeypatch):
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown(monkeypatch))

    assert "choosing touches" in text
    assert "s left" in text
    assert max(map(len, re.split(r"[\r\n]", text))) <= 60


def test_no_color_means_no_colour(monkeypatch):
    colour = re.compile(r"\x1b\[(?:[0-9;]*;)?(?:3[0-7]|38|9[0-7])[;m]")

    assert colour.search(shown(monkeypatch))
    assert not colour.search(shown(monkeypatch, NO_COLOR="1"))


@pytest.mark.parametrize("show", [True, False])
def test_a_pipe_sees_nothing(show, monkeypatch):
    pipe = io.StringIO()
    monkeypatch.setattr(sys, "stderr", pipe)

    with progress(show, "identifying") as update:
        update("choosing touches", 0.5)

    assert pipe.getvalue() == ""
