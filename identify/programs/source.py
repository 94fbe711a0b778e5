"""A program as text whose every character is one byte of the file, and a scanner that says where it stopped."""

import re
from dataclasses import dataclass
from functools import cached_property
from typing import NoReturn

from identify.model.files import InputError, Mistake


@dataclass(frozen=True)
class Source:
    """A program: its bytes as Latin-1, so that any encoding and any line end comes back as it was."""

    name: str
    text: str

    @cached_property
    def _ends(self) -> list[int]:
        return [match.end() for match in re.finditer(r"\r\n|\n|\r", self.text)]

    def line(self, at: int) -> int:
        """The line of a place, from 1."""
        from bisect import bisect_right

        return bisect_right(self._ends, at) + 1

    def fail(self, at: int, sentence: str) -> NoReturn:
        """Refuse the file for what stands at a place."""
        line = self.line(at)
        column = at - (self._ends[line - 2] if line > 1 else 0) + 1
        raise InputError([Mistake(self.name, line, f"column {column}: {sentence}")])

    def near(self, at: int) -> str:
        """What stands at a place, for a sentence."""
        word = re.compile(r"[^\s,;]{0,20}").match(self.text, at)
        return repr(word[0]) if word and word[0] else "the end of the line" if at < len(self.text) else "the end"


def source_of(name: str, content: bytes) -> Source:
    """A program from its bytes; refuses what is no text with a byte a character."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in content:
        raise InputError([Mistake(name, 0, "not a text of single bytes (UTF-16?); save it as ASCII or UTF-8")])
    return Source(name, content.decode("latin-1"))


class Scanner:
    """Reads a source from a place on, pattern by pattern, white space skipped."""

    def __init__(self, source: Source, at: int = 0, view: str | None = None) -> None:
        self.source, self.at = source, at
        self.view = source.text if view is None else view  # the text with comments blanked, as long as the text itself

    def skip(self) -> int:
        """Go past white space."""
        while self.at < len(self.view) and self.view[self.at].isspace():
            self.at += 1
        return self.at

    def take(self, pattern: str) -> re.Match[str] | None:
        """What matches here, past white space, or nothing."""
        match = re.compile(pattern, re.IGNORECASE).match(self.view, self.skip())
        if match:
            self.at = match.end()
        return match

    def need(self, pattern: str, what: str) -> re.Match[str]:
        """What matches here; refuses the file where nothing does."""
        match = self.take(pattern)
        if match is None:
            self.source.fail(self.at, f"found {self.source.near(self.at)}, expected {what}")
        return match


def blanked(text: str, comment: str, string: str | None = None) -> str:
    """A text of the same length without comments and without what stands inside strings.

    The two patterns are searched together from the left, so that neither is found inside the other.
    """

    def blank(match: re.Match[str]) -> str:
        if string is not None and match.lastgroup == "string":
            return match[0][0] + re.sub(r"[^\r\n]", "_", match[0][1:-1]) + match[0][-1]
        return re.sub(r"[^\r\n]", " ", match[0])

    parts = f"(?P<comment>{comment})" + (f"|(?P<string>{string})" if string else "")
    return re.sub(parts, blank, text, flags=re.MULTILINE)
