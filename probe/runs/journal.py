"""A file of records that survives being killed at any byte: a checksum a line, synced before the next step."""

import json
import os
import zlib
from pathlib import Path
from typing import Any

from identify.model.files import InputError, Mistake

Record = dict[str, Any]


def line_of(record: Record) -> bytes:
    """A record as a line of JSON whose last entry is the CRC-32 of what stands before it."""
    body = json.dumps(record, ensure_ascii=True, allow_nan=False)[:-1]
    return f'{body}, "crc": "{zlib.crc32(body.encode()):08x}"}}\n'.encode()


def record_of(line: bytes) -> Record | None:
    """The record of a line; None where the line is torn or changed."""
    body, mark, rest = line.rpartition(b', "crc": "')
    if not mark or rest != f'{zlib.crc32(body):08x}"}}'.encode():
        return None
    record = json.loads(body + b"}")
    return record if isinstance(record, dict) else None


def read_records(path: Path) -> tuple[list[Record], int]:
    """The records of a journal and the length of what is whole [bytes]; a torn last line is left out.

    Raises InputError where a line in the middle is damaged: that is no kill but a broken disk, or an editor.
    """
    try:
        lines = path.read_bytes().split(b"\n")
    except FileNotFoundError:
        return [], 0
    records, length = list[Record](), 0
    for number, line in enumerate(lines[:-1], 1):
        record = record_of(line)
        if record is None and not any(map(record_of, lines[number:])):
            break
        if record is None:
            text = "this line is damaged, but later ones are whole; restore the journal, or begin a new session"
            raise InputError([Mistake(str(path), number, text)])
        records.append(record)
        length += len(line) + 1
    return records, length


class Journal:
    """A journal being written."""

    def __init__(self, path: Path) -> None:
        self.records, length = read_records(path)
        self._file = path.open("r+b" if path.exists() else "w+b", buffering=0)
        if self._file.seek(0, os.SEEK_END) != length:
            self._file.truncate(length)  # a torn last line
            self._file.seek(length)
        sync_folder(path)

    def append(self, record: Record) -> None:
        """Write a record and return when the disk has it."""
        data = line_of(record)
        while data:
            data = data[self._file.write(data) :]
        os.fsync(self._file.fileno())
        self.records.append(record)

    def clear(self) -> None:
        """Begin anew."""
        self._file.truncate(0)
        self._file.seek(0)
        self.records.clear()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def sync_folder(path: Path) -> None:
    """Have the disk know the name of a new file, where the system can."""
    if os.name == "posix":
        handle = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
