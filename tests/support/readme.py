"""The README as tests read it: its blocks, its commands as a user runs them, and its demo."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

LONGEST = 600  # [s], of a shell block
ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
REAL_ROBOT = ROOT / "studies" / "examples" / "irb120.md"


@dataclass(frozen=True)
class Block:
    """A fenced block, the comment above it, and the heading over it."""

    language: str
    text: str
    comment: str
    heading: str


def blocks(page=README):
    found, text = [], []
    heading, comment, inside = "", "", None
    for line in page.read_text(encoding="utf-8").splitlines():
        if inside is not None:
            if line == "```":
                found.append(Block(inside, "\n".join(text), comment, heading))
                inside, comment = None, ""
            else:
                text.append(line)
        elif line.startswith("```"):
            inside, text = line[3:], []
        elif line.startswith("#"):
            heading = line.lstrip("# ")
        elif line.startswith("<!--"):
            comment = line.removeprefix("<!-- ").removesuffix(" -->")
    return found


def block(comment, page=README):
    return next(b for b in blocks(page) if b.comment == comment)


def activated():
    """The environment of a user who has activated ours."""
    return os.environ | {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}


def run(command, folder, **environment):
    """Run a shell block as a user does; what it says. What it started and did not stop is stopped at its end."""
    shell = subprocess.Popen(
        ["bash", "-euo", "pipefail", "-c", command],
        cwd=folder,
        env=activated() | environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        shell.wait(LONGEST)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(shell.pid, signal.SIGTERM)
    said, errors = shell.communicate()
    assert shell.returncode == 0, errors
    return said


@dataclass(frozen=True)
class Demo:
    """The folder in which the first command of the README was run, what it was, what it made and what it said."""

    command: str
    folder: Path
    said: str

    @classmethod
    def made(cls, folder: Path) -> "Demo":
        """Run that command in a folder."""
        whole = next(b.text for b in blocks() if b.heading == "Run the demo" and b.language == "sh")
        command = whole.rpartition("&& .venv/bin/")[2]
        return cls(command, folder / "demo", run(command, folder))
