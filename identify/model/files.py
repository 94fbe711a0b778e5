"""Files in and out: every mistake with its file and line, and nothing half-written."""

import csv
import hashlib
import io
import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

LONGEST_ID = 200  # [characters]
LISTED = 20  # mistakes shown of one file: beyond that, the reader has seen the pattern


@dataclass(frozen=True, order=True)
class Mistake:
    """One thing wrong in a file, with the cure."""

    file: str
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.text}" if self.line else f"{self.file}: {self.text}"


class InputError(ValueError):
    """What the user gave cannot be used; carries every mistake found."""

    def __init__(self, mistakes: Sequence[Mistake] | str) -> None:
        self.mistakes = [mistakes] if isinstance(mistakes, str) else sorted(mistakes)
        more = len(self.mistakes) - LISTED
        lines = [str(m) for m in self.mistakes[:LISTED]] + ([f"... and {more} more"] if more > 0 else [])
        super().__init__("\n".join(lines))


def is_plain(text: str) -> bool:
    """Whether a text may hold numbers: Python reads 1_0 as 10, and digits of every script."""
    return text.isascii() and "_" not in text


def read_text(path: Path) -> str:
    """The text of a file, or one sentence why there is none."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError([Mistake(str(path), 0, "no such file; check the name and the folder")]) from None
    except UnicodeDecodeError as error:
        raise InputError(
            [Mistake(str(path), 0, f"not a text file in UTF-8 (byte {error.start}); save it as UTF-8")]
        ) from None
    except OSError as error:
        raise InputError([Mistake(str(path), 0, f"cannot be read: {error.strerror}")]) from None


def read_bytes(path: Path) -> bytes:
    """The bytes of a file, or one sentence why there are none."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError([Mistake(str(path), 0, "no such file; check the name and the folder")]) from None
    except OSError as error:
        raise InputError([Mistake(str(path), 0, f"cannot be read: {error.strerror}")]) from None


def write_text(path: Path, text: str) -> None:
    """Write a file in UTF-8, whole or not at all."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: to a temporary neighbour, synced, then renamed."""
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            Path(temporary).chmod(0o666 & ~_umask())
            Path(temporary).replace(path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise InputError(
            [Mistake(str(path), 0, f"cannot be written: {error.strerror}; choose another place with -o")]
        ) from None


def write_json(path: Path, entry: Mapping[str, Any], inputs: Mapping[str, str]) -> None:
    """Write an entry, with what made it: the version of touchcal, and the hashes of the files that were read."""
    write_text(path, json.dumps({"touchcal": version("touchcal"), "inputs": dict(inputs), **entry}, indent=1) + "\n")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def digest(path: Path) -> str:
    """SHA-256 of a file, to say later what a result was made from."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


@dataclass
class Sheet:
    """A CSV file being read: its columns as text, its line numbers, and the mistakes found so far."""

    file: str
    columns: dict[str, list[str]]
    lines: list[int]
    mistakes: list[Mistake] = field(default_factory=list)

    def wrong(self, row: int, text: str) -> None:
        """Note a mistake in a row."""
        self.at(self.lines[row], text)

    def at(self, line: int, text: str) -> None:
        """Note a mistake at a line: 1 is the header, 0 the whole file."""
        self.mistakes.append(Mistake(self.file, line, text))

    def stop(self) -> None:
        """Raise what was found, all of it."""
        if self.mistakes:
            raise InputError(list(dict.fromkeys(self.mistakes)))

    def text(self, name: str, default: str = "") -> list[str]:
        """A column of text, stripped."""
        return [cell.strip() for cell in self.columns[name]] if name in self.columns else [default] * len(self.lines)

    def ids(self) -> list[str]:
        """The names of the rows; one that is empty or stands twice is a mistake."""
        ids, first = self.text("id"), dict[str, int]()
        for row, name in enumerate(ids if "id" in self.columns else []):
            if not name:
                self.wrong(row, "id is empty; give every row a name of its own")
            elif len(name) > LONGEST_ID:
                self.wrong(row, f"id '{name[:20]}...' has {len(name)} characters, expected at most {LONGEST_ID}")
            elif name in first:
                self.wrong(row, f"id '{name}' stands already in line {first[name]}; give every row a name of its own")
            first.setdefault(name, self.lines[row])
        return ids

    def numbers(self, name: str, default: float | None = None) -> np.ndarray:
        """A column of finite numbers; empty cells take the default, or are mistakes where there is none."""
        if name not in self.columns:  # a mistake already where the column is required
            return np.full(len(self.lines), np.nan if default is None else default)
        cells = self.text(name)
        try:
            if is_plain("".join(cells)):
                values = np.array(cells, dtype=float)  # the whole column at once: the usual case of a clean file
                if np.isfinite(values).all():
                    return values
        except ValueError:
            pass
        return np.array([self._number(row, name, cell, default) for row, cell in enumerate(cells)])

    def _number(self, row: int, name: str, cell: str, default: float | None) -> float:
        if not cell and default is not None:
            return default
        try:
            value = float(cell) if is_plain(cell) else float("nan")
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            cure = "write it with a decimal point" if "," in cell else "measure it again or delete the row"
            self.wrong(row, f"{name} is {cell or 'empty'!r}, expected a number; {cure}")
        return value


def read_sheet(path: Path | str, required: Sequence[str], optional: Iterable[str]) -> Sheet:
    """Read a CSV file with a header line; unknown columns warn, missing ones and torn lines are noted as mistakes."""
    path = Path(path)
    import warnings

    text = read_text(path)
    if not text.strip():
        raise InputError([Mistake(str(path), 0, "the file is empty, expected a header line and rows")])
    torn = 0 if text.endswith("\n") else text.count("\n") + 1
    if text.lstrip()[0] in "{<":
        kind = "JSON" if text.lstrip()[0] == "{" else "XML"
        raise InputError([Mistake(str(path), 0, f"this is {kind}, expected a table of commas with a header line")])
    sheet = Sheet(str(path), {}, [])
    rows = _rows(sheet, text)
    header = [name.strip() for name in next(rows, (1, []))[1]]
    while header and not header[-1]:  # spreadsheets leave commas behind
        header.pop()
    sheet.columns |= {name: [] for name in header}
    allowed = {*optional, *required}
    unknown = [name for name in header if name not in allowed]
    _check_header(sheet, header, required, unknown)
    for name in unknown:
        if with_unit := [
            column for column in sorted(allowed.difference(required)) if column.rpartition("_")[0] == name
        ]:
            sheet.at(1, f"column '{name}' has no unit; write it as {' or '.join(map(repr, with_unit))}")
    for line, row in rows:
        _add_row(sheet, header, row, line, torn)
    if torn:
        cure = "complete it and end it with a newline, or delete it"
        sheet.at(torn, f"the last line does not end, it may be torn; {cure}")
    if unknown and not sheet.mistakes:
        warnings.warn(f"{path}: unknown column {', '.join(map(repr, unknown))} ignored", stacklevel=2)
    return sheet


def _rows(sheet: Sheet, text: str) -> Iterator[tuple[int, list[str]]]:
    """Lines and their cells, as far as they can be told apart."""
    reader = csv.reader(io.StringIO(text), skipinitialspace=True)
    try:
        for row in reader:
            yield reader.line_num, row
    except csv.Error as error:
        sheet.at(reader.line_num, f"{error}; is a quotation mark left open?")


def _check_header(sheet: Sheet, header: list[str], required: Sequence[str], unknown: list[str]) -> None:
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        text = "columns are parted by semicolons or tabs; save the file with commas, and points in numbers"
        raise InputError([Mistake(sheet.file, 1, text)])
    repeated = sorted({name for name in header if header.count(name) > 1})
    if repeated:
        sheet.at(1, f"column {', '.join(map(repr, repeated))} stands twice in the header; keep one")
    for name in required:
        if name not in sheet.columns:
            near = (
                nearest(name, [other for other in unknown if other[:1] == name[:1]])
                .removeprefix("; did you mean ")
                .removesuffix("?")
            )
            cure = f"; if {near} is meant, write it under this name, in this unit" if near else ""
            sheet.at(1, f"column '{name}' is missing{cure}")


def _add_row(sheet: Sheet, header: list[str], row: list[str], line: int, torn: int) -> None:
    if not any(cell.strip() for cell in row):
        return
    while len(row) > len(header) and not row[-1].strip():
        row.pop()
    if len(row) != len(header):
        cure = "the line is cut short; complete or delete it" if len(row) < len(header) else "is a decimal comma in it?"
        if line != torn:
            sheet.at(line, f"{len(row)} cells where the header has {len(header)}; {cure}")
        return
    sheet.lines.append(line)
    for name, cell in dict(zip(header, row, strict=True)).items():
        sheet.columns[name].append(cell)


def nearest(name: str, names: Iterable[str]) -> str:
    """A hint at the name that was meant, or nothing."""
    import difflib

    named = [k for k in names if k]
    alike = (k for k in named if name and (k.startswith(f"{name}_") or name.startswith(f"{k}_")))  # but for the unit
    close = difflib.get_close_matches(name, named, 1) or [*alike]
    return f"; did you mean '{close[0]}'?" if close else ""


def sheet_text(columns: Mapping[str, Sequence[Any] | np.ndarray]) -> str:
    """A CSV text from columns; numbers are written shortest and exact."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*[_cells(c) for c in columns.values()], strict=True))
    return out.getvalue()


def _cells(column: Sequence[Any] | np.ndarray) -> list[Any]:
    """Floats of NumPy as Python's, empty where unknown."""
    if not isinstance(column, np.ndarray):
        return list(column)
    return ["" if isinstance(value, float) and np.isnan(value) else value for value in column.tolist()]
