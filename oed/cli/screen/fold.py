"""Long lines folded at the width of the screen."""

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from shutil import get_terminal_size
from textwrap import wrap
from typing import Any, TextIO, cast

LEAST = 20  # columns: a screen says 0 if it does not know
CONTROL = "\x1b\r"  # characters of lines that move the cursor


class FoldedLines:
    """A text stream that writes to another one, long lines folded between words."""

    def __init__(self, whole: TextIO) -> None:
        self.whole = whole  # the stream that gets lines as they are

    def write(self, text: str) -> int:
        """Write a text, each line in as many as it takes."""
        return self.whole.write("".join(folded(line) for line in text.splitlines(keepends=True)))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.whole, name)


def folded(line: str) -> str:
    """A line in as many as it takes, the later ones indented; a line that moves the cursor stays as it is."""
    text, width = line.rstrip("\n"), max(get_terminal_size().columns, LEAST)
    if len(text) <= width or any(character in text for character in CONTROL):
        return line
    indent = " " * (len(text) - len(text.lstrip()) + 2)
    lines = wrap(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines) + line[len(text) :]


@contextmanager
def folding() -> Iterator[None]:
    """Fold what is printed where a person reads it: on a terminal, or where COLUMNS says how wide the screen is."""
    with ExitStack() as stack:
        for stream, redirect in ((sys.stdout, redirect_stdout), (sys.stderr, redirect_stderr)):
            if stream.isatty() or "COLUMNS" in os.environ:
                stack.enter_context(redirect(cast(TextIO, FoldedLines(stream))))
        yield
