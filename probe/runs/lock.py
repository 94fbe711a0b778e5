"""One program at a time: an exclusive lock that the operating system takes back when the program dies."""

import os
import sys
from pathlib import Path

from identify.model.files import InputError


class Lock:
    """A lock on a file of its own; the file stays, the lock goes with the program."""

    def __init__(self, path: Path) -> None:
        try:
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}; choose another folder") from None
        try:
            _lock(self._handle)
        except OSError:
            os.close(self._handle)
            raise InputError(f"{path}: another program works on this session; wait for it or end it") from None

    def release(self) -> None:
        """Give the lock back."""
        os.close(self._handle)


if sys.platform == "win32":
    import msvcrt

    def _lock(handle: int) -> None:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
