"""Bytes into lines, and the lines of TOUCH/1 with their checksums."""

import binascii

LONGEST = 200  # [bytes] of a line, its end included


class Lines:
    """Cuts a stream of bytes into lines; what is too long to be one is thrown away up to the next line end."""

    def __init__(self, longest: int = LONGEST) -> None:
        self._longest = longest
        self._rest = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes]:
        """The lines that these bytes complete, without their ends; empty ones are left out."""
        *whole, self._rest = (self._rest + data).split(b"\n")
        if whole and self._skipping:
            whole, self._skipping = whole[1:], False
        if len(self._rest) > self._longest:
            self._rest, self._skipping = b"", True
        return [line for line in (raw.strip(b"\r") for raw in whole) if 0 < len(line) < self._longest]


def checksum(text: bytes) -> str:
    """CRC-16/CCITT from 0xFFFF, as four hex digits."""
    return f"{binascii.crc_hqx(text, 0xFFFF):04X}"


def seal(text: str) -> bytes:
    """A line with its checksum and its end."""
    body = text.encode("ascii")
    line = body + b"*" + checksum(body).encode() + b"\n"
    if len(line) > LONGEST:
        raise ValueError(f"line of {len(line)} bytes, expected at most {LONGEST}: {text[:40]}...")
    return line


def unseal(line: bytes) -> str | None:
    """The text of a line whose checksum is right; None where it is not."""
    body, star, digits = line.rpartition(b"*")
    if not star or digits != checksum(body).encode():
        return None
    try:
        return body.decode("ascii")
    except UnicodeDecodeError:
        return None
