"""How far work has come, for a person who waits."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

LEAST = 0.03  # share of the work from which on the rest of the time can be told


@contextmanager
def progress(show: bool, what: str = "") -> Iterator[Callable[[str, float], None]]:
    """A bar on stderr with the time that remains; nothing if the output is piped.

    Work that does not say how far it has come gets a moving bar and the time that it has taken.
    """
    if not (show and sys.stderr.isatty()):
        yield lambda what, share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True, expand=True) as bar:
        task, start = bar.add_task(what, total=None, left=""), monotonic()

        def update(what: str, share: float) -> None:
            seconds = remaining(monotonic() - start, share)
            bar.update(task, description=what, total=1.0, completed=share, left=seconds)

        yield update


def remaining(seconds: float, share: float) -> str:
    """The time that remains in words, where this share of the work took so many seconds."""
    if not LEAST <= share < 1:
        return ""
    rest = seconds * (1 - share) / share
    return f"{rest:.0f} s left" if rest < 90 else f"{rest / 60:.0f} min left"
