"""Lines and their checksums, against zlib-free arithmetic; no bit changes unseen."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from probe.line.framing import LONGEST, Lines, checksum, seal, unseal


def crc_by_division(text: bytes) -> int:
    """CRC-16/CCITT by long division in the field of two, from 0xFFFF."""
    register = 0xFFFF
    for byte in text:
        for bit in range(7, -1, -1):
            carry = (register >> 15) ^ (byte >> bit & 1)
            register = (register << 1 & 0xFFFF) ^ (0x1021 if carry else 0)
    return register


def test_the_checksum_is_the_published_one() -> None:
    assert checksum(b"123456789") == "29B1"  # the check value of CRC-16/CCITT-FALSE


@given(st.binary(max_size=60))
def test_the_checksum_is_a_division_of_polynomials(text: bytes) -> None:
    assert int(checksum(text), 16) == crc_by_division(text)


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=150))
def test_a_sealed_line_opens_to_what_it_was(text: str) -> None:
    (line,) = Lines().feed(seal(text))

    assert unseal(line) == text


@given(st.data())
def test_no_single_bit_changes_unseen(data: st.DataObject) -> None:
    sealed = seal(data.draw(st.from_regex(r"[1-9][0-9]{0,3} MOVE [0-9.,]{1,60}", fullmatch=True)))
    position, bit = data.draw(st.integers(0, len(sealed) - 2)), data.draw(st.integers(0, 7))
    flipped = sealed[:position] + bytes([sealed[position] ^ 1 << bit]) + sealed[position + 1 :]

    assert all(unseal(line) is None for line in Lines().feed(flipped))


@given(st.lists(st.text("abc*", min_size=1, max_size=20), max_size=8), st.data())
def test_lines_do_not_care_how_the_bytes_arrive(texts: list[str], data: st.DataObject) -> None:
    stream = b"".join(text.encode() + b"\r\n" for text in texts)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    lines, heard = Lines(), list[bytes]()

    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        heard += lines.feed(stream[start:end])

    assert heard == [text.encode() for text in texts]


def test_a_line_without_end_does_not_fill_the_memory_and_costs_only_itself() -> None:
    lines = Lines()

    heard = [line for _ in range(1000) for line in lines.feed(b"x" * 100)]

    assert heard == []
    assert lines.feed(b"rest of it\ngood\n") == [b"good"]


def test_a_line_longer_than_the_protocol_allows_is_not_sent() -> None:
    with pytest.raises(ValueError, match="at most 200"):
        seal("x" * LONGEST)
