"""A file of records that survives being killed at any byte: a running number and a checksum a line, synced at once."""

import json
import os
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from identify.model.files import write_text
from probe.line.controller import TouchError

Record = dict[str, Any]
NUMBER = "number"  # the key of the running number; journals of the first version have none


def line_of(record: Record) -> bytes:
    """A record as a line of JSON whose last entry is the CRC-32 of what stands before it."""
    body = json.dumps(record, ensure_ascii=True, allow_nan=False)[:-1]
    return f'{body}, "crc": "{zlib.crc32(body.encode()):08x}"}}\n'.encode()


def record_of(line: bytes) -> Record | None:
    """The record of a line; None where the line is torn or changed."""
    body, mark, rest = line.rpartition(b', "crc": "')
    if not mark or rest != f'{zlib.crc32(body):08x}"}}'.encode():
        return None
    try:
        record = json.loads(body + b"}")
    except ValueError:
        return None
    return record if isinstance(record, dict) else None


@dataclass
class Contents:
    """What a journal holds: its whole records in their order, and what is broken, one sentence a place."""

    records: list[Record] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)
    torn: bool = False  # whether the last line is torn, as a kill leaves it: nothing to worry about


def read_records(path: Path) -> Contents:
    """The whole records of a journal; damaged, repeated and missing ones are named, none is an error.

    A last line without its end is what a kill in the middle of writing leaves: it is left out and not called broken.
    """
    try:
        lines = path.read_bytes().split(b"\n")
    except FileNotFoundError:
        return Contents()
    except OSError as error:
        raise TouchError(f"{path}: cannot be read: {error.strerror}") from None
    contents, next_number = Contents(torn=bool(lines[-1])), 0
    for place, line in enumerate(lines[:-1], 1):
        record = record_of(line)
        number = next_number if record is None else record.get(NUMBER, next_number)
        if record is None:
            contents.broken.append(f"line {place} is damaged")
        elif not isinstance(number, int) or number < next_number:
            contents.broken.append(f"line {place} repeats record {number}")
            continue
        else:
            if number > next_number:
                contents.broken.append(f"before line {place}, {number - next_number} records are missing")
            contents.records.append(record)
        next_number = number + 1
    return contents


class Journal:
    """A journal being written.

    What is broken is named in `broken`; a copy of the journal as it was stays beside it, and the journal goes on with
    the whole records.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        contents = read_records(path)
        self.records, self.broken, self.copy = contents.records, contents.broken, ""
        if contents.broken:
            self.copy = keep_copy(path).name
        if contents.broken or contents.torn:
            self._renumber()
            write_text(path, b"".join(map(line_of, self.records)).decode())
        self._file = path.open("r+b" if path.exists() else "w+b", buffering=0)
        self._file.seek(0, os.SEEK_END)
        sync_folder(path)

    def append(self, record: Record) -> None:
        """Write a record and return when the disk has it; raises TouchError where the disk does not take it."""
        record = {NUMBER: len(self.records)} | record
        data, length = line_of(record), self._file.tell()
        try:
            while data:
                data = data[self._file.write(data) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            self._cut(length)
            raise unwritable(self.path, error) from error
        self.records.append(record)

    def clear(self) -> None:
        """Begin anew."""
        self._cut(0)
        self.records.clear()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _cut(self, length: int) -> None:
        self._file.truncate(length)
        self._file.seek(length)

    def _renumber(self) -> None:
        for number, record in enumerate(self.records):
            record[NUMBER] = number


def unwritable(path: Path, error: OSError) -> TouchError:
    """The error of a disk that does not take what was measured."""
    return TouchError(
        f"{path}: cannot be written: {error.strerror}; the robot stands, and all that was written before is kept: "
        "make room on the disk, then go on with --resume"
    )


def keep_copy(path: Path) -> Path:
    """Keep what a file holds beside it, under a name that nothing has yet: touches.csv.bak, touches.csv.bak2, ..."""
    copy, number = path.with_name(path.name + ".bak"), 1
    while copy.exists():
        number += 1
        copy = path.with_name(f"{path.name}.bak{number}")
    copy.write_bytes(path.read_bytes())
    return copy


def sync_folder(path: Path) -> None:
    """Have the disk know the name of a new file, where the system can."""
    if os.name == "posix":
        handle = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
