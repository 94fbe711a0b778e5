"""Touches as they are made, on the screen: a table that lives where a person looks, lines where a file listens."""

import sys
from collections import deque
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

if TYPE_CHECKING:
    from probe.runs.events import Event, Touched

ROWS = 14  # touches in sight


class Screen:
    """Listens to a run and shows it on stderr."""

    def __init__(self, silent: bool = False) -> None:
        self.silent = silent
        self.rows: deque[tuple[str, ...]] = deque(maxlen=ROWS)
        self.now, self.done, self.total, self.left = "", 0, 0, float("nan")
        self._live: Any = None

    def __enter__(self) -> Self:
        if not self.silent and sys.stderr.isatty():
            from rich.console import Console
            from rich.live import Live

            self._live = Live(console=Console(stderr=True), get_renderable=self._table, refresh_per_second=8)
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    def tell(self, event: "Event") -> None:
        """Show what happened."""
        from probe.runs.events import Drifted, Recovered, Retried, Started, Touched, Touching, Waiting

        match event:
            case Started(total, done, controller):
                self.total, self.done = total, done
                self._line(f"{controller}: {total} touches" + (f", {done} made before" if done else ""))
            case Touching(name, face, attempt):
                self.now = f"touch {name} on {face}" + (f", attempt {attempt}" if attempt > 1 else "")
            case Retried(name, attempt, reason):
                self._line(f"touch {name}, attempt {attempt}: {reason}")
            case Touched():
                self._touched(event)
            case Drifted(name, change):
                self._line(f"touch {name}: {change:+.3f} mm from its first time")
            case Waiting(reason) | Recovered(reason):
                self._line(reason)
            case _:
                pass

    def _touched(self, event: "Touched") -> None:
        self.done, self.left = event.done, event.seconds_left
        residual = "" if np.isnan(event.residual) else f"{event.residual:+.3f}"
        surprise = "" if np.isnan(event.surprise) else f"{event.surprise:+.3f}"
        self.rows.append((event.id, event.face, event.status, residual, surprise, str(event.attempts), event.note))
        if self._live is None:
            self._line(
                f"[{event.done}/{event.total}] {event.id} {event.face} {event.status} residual {residual or '-'} mm "
                f"surprise {surprise or '-'} mm{f', {event.note}' if event.note else ''}, {self._time()} left"
            )

    def _time(self) -> str:
        return "?" if np.isnan(self.left) else f"{self.left / 60:.1f} min"

    def _line(self, text: str) -> None:
        self.now = text
        if not self.silent and self._live is None:
            print(text, file=sys.stderr)

    def _table(self) -> Any:
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        table = Table("touch", "face", "status", "residual, mm", "surprise, mm", "tries", "note", box=None)
        for row in self.rows:
            table.add_row(*map(Text, row))
        share = ProgressBar(total=max(self.total, 1), completed=self.done, width=40)
        return Group(table, share, Text(f"{self.done} of {self.total}, {self._time()} left; {self.now}"))
