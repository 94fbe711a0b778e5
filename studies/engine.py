"""Run a study: its tasks on this machine or on a Dask cluster, each finished one on disk and never repeated.

A task is a dictionary of names and numbers, the same on every machine. Its random numbers come from the seed and from
what the task says, not from when or where it runs, so that the result is the same on one process and on a hundred.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from identify.model.files import InputError, is_plain, nearest, read_sheet, read_text, sheet_text, write_text
from oed.criteria.own import OwnCriterion
from studies import STUDIES

Task = Mapping[str, Any]
Table = dict[str, list[Any]]  # a tidy table: columns of equal length, text or numbers
Compute = Callable[[str, Sequence[tuple[int, Task]], int], Iterator[tuple[int, str]]]
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Study:
    """A question and the script that answers it."""

    name: str
    """One of STUDIES."""
    module: ModuleType
    """Its script."""
    criterion: OwnCriterion | None = None
    """One of one's own to compare, where the study compares criteria."""

    @classmethod
    def named(cls, name: str, criterion: OwnCriterion | None = None) -> "Study":
        """The study of a name, with a criterion of one's own; raises InputError where there is none."""
        if name not in STUDIES:
            raise InputError(f"there is no study '{name}'{nearest(name, STUDIES)}; choose one of {', '.join(STUDIES)}")
        module = import_module(f"studies.{name}")
        if criterion is not None:
            if "own" not in signature(module.tasks).parameters:
                raise InputError(
                    f"study '{name}' compares no criteria; --criterion goes with touchcal study strategies"
                )
            criterion.define()
        return cls(name, module, criterion)

    @property
    def story(self) -> str:
        """Question, setup and answer."""
        return (self.module.__doc__ or "").strip()

    @property
    def question(self) -> str:
        """The question alone, on one line."""
        return " ".join(self.story.partition("\n\n")[0].split())

    @property
    def alone(self) -> bool:
        """Whether it reads clocks, so that its tasks are better not computed beside each other."""
        return bool(getattr(self.module, "ALONE", False))

    def tasks(self, small: bool) -> list[dict[str, Any]]:
        """What there is to compute, in the order of the table."""
        return list(self.module.tasks(small, **({} if self.criterion is None else {"own": vars(self.criterion)})))

    def answer(self, table: Table) -> str:
        """The answer in words, with numbers of the table."""
        return str(self.module.answer(table))

    def pictures(self, table: Table) -> dict[str, str]:
        """SVG texts by name."""
        return dict(self.module.pictures(table))


def compute(name: str, task: Task, seed: int) -> str:
    """The rows of one task as CSV; what a worker does."""
    text = json.dumps(task, sort_keys=True)
    key = hashlib.sha256(f"{name} {text}".encode()).digest()
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(key[:16])))
    with threadpool_limits(1):  # sums of several threads differ in the last digit
        rows = import_module(f"studies.{name}").run(rng, **task)
    return sheet_text({column: [row[column] for row in rows] for column in rows[0]})


def here(name: str, tasks: Sequence[tuple[int, Task]], seed: int) -> Iterator[tuple[int, str]]:
    """Compute tasks one after the other in this process."""
    for index, task in tasks:
        yield index, compute(name, task, seed)


def evaluate(
    study: Study, folder: Path, *, small: bool, seed: int, using: Compute = here, progress: Progress | None = None
) -> Table:
    """All rows of a study; finished tasks of an earlier run with the same script and seed are read from `folder`."""
    tasks = study.tasks(small)
    paths = [folder / "chunks" / f"{_key(study, task, seed)}.csv" for task in tasks]
    missing = [(index, tasks[index]) for index, path in enumerate(paths) if not path.exists()]
    (folder / "chunks").mkdir(parents=True, exist_ok=True)
    count = len(tasks) - len(missing)
    for index, text in using(study.name, missing, seed):
        write_text(paths[index], text)
        count += 1
        if progress is not None:
            progress(f"{count} of {len(tasks)} tasks", count / len(tasks))
    return joined([read_table(path) for path in paths])


def _key(study: Study, task: Task, seed: int) -> str:
    """A name for the result of a task that changes with touchcal, the script, the task and the seed."""
    source = read_text(Path(study.module.__file__ or ""))
    key = json.dumps([version("touchcal"), study.name, source, task, seed], sort_keys=True)
    return hashlib.sha256(key.encode()).hexdigest()[:20]


def read_table(path: Path) -> Table:
    """A table from CSV: columns that hold numbers alone become numbers, empty cells NaN."""
    sheet = read_sheet(path, (), _header(path))
    sheet.stop()
    return {name: _column(cells) for name, cells in sheet.columns.items()}


def _header(path: Path) -> list[str]:
    return read_text(path).partition("\n")[0].split(",")


def _column(cells: Sequence[str]) -> list[Any]:
    if not all(map(is_plain, cells)):  # float reads 1_0 and digits of every alphabet
        return list(cells)
    try:
        return [float(cell) if cell else float("nan") for cell in cells]
    except ValueError:
        return list(cells)


def joined(tables: Sequence[Table]) -> Table:
    """Tables one below the other; a column that one of them does not have is empty there."""
    names = list(dict.fromkeys(name for table in tables for name in table))
    lengths = [len(next(iter(table.values()))) for table in tables]
    words = {name for table in tables for name, cells in table.items() if any(isinstance(c, str) for c in cells)}
    empty = {name: "" if name in words else float("nan") for name in names}
    return {
        name: [cell for t, n in zip(tables, lengths, strict=True) for cell in t.get(name, [empty[name]] * n)]
        for name in names
    }


def write_results(study: Study, table: Table, folder: Path) -> list[Path]:
    """The table as CSV and the pictures as SVG; returns the files."""
    files = {folder / f"{study.name}.csv": sheet_text({k: _plain(v) for k, v in table.items()})}
    files |= {folder / f"{name}.svg": picture for name, picture in study.pictures(table).items()}
    folder.mkdir(parents=True, exist_ok=True)
    for path, text in files.items():
        write_text(path, text)
    return list(files)


def _plain(column: Sequence[Any]) -> list[Any]:
    """Whole numbers without a point, unknown ones empty."""
    return [
        "" if isinstance(v, float) and np.isnan(v) else int(v) if isinstance(v, float) and v.is_integer() else v
        for v in column
    ]


def column(table: Table, name: str) -> np.ndarray:
    """A column of numbers."""
    return np.array(table[name], dtype=float)


def where(table: Table, **values: Any) -> Table:
    """The rows in which columns have given values."""
    count = len(next(iter(table.values())))
    keep = [i for i in range(count) if all(table[name][i] == value for name, value in values.items())]
    return {name: [cells[i] for i in keep] for name, cells in table.items()}


def distinct(table: Table, name: str) -> list[Any]:
    """The values of a column, each once, in the order of their first rows."""
    return list(dict.fromkeys(table[name]))
