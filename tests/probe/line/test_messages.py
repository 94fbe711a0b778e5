"""Lines of TOUCH/1 are read as DESIGN section 6 writes them, and nothing else is."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from probe.line.messages import ANSWER, GREETING, LAST_NUMBER, Status, following, read_status


def test_a_status_is_read_with_and_without_the_number_that_it_answers() -> None:
    text = "! ST boot=A1B2 RUN seq=12 hb=7 probe=1 q=1.00000,-2.50000"

    assert read_status(text) == Status("A1B2", True, 12, 7, True, "1.00000,-2.50000")
    first_version = text.replace(" hb=7", "").replace("RUN", "IDLE").replace("probe=1", "probe=0")
    assert read_status(first_version) == Status("A1B2", False, 12, 0, False, "1.00000,-2.50000")


def test_words_that_another_maker_adds_behind_are_ignored() -> None:
    """The defect: a controller that named its maker in the greeting was not recognised."""
    status = "! ST boot=A1B2 RUN seq=12 hb=7 probe=1 q=1.00000,-2.50000"
    greeting = GREETING.fullmatch("0 OK TOUCH/1 boot=X9 joints=6 last=41 nonce=5f vendor=Acme v2")

    assert read_status(f"{status} tool=1 temp=31.5") == read_status(status)
    assert greeting is not None
    assert greeting.groups() == ("X9", "6", "41", "5f")


@pytest.mark.parametrize("broken", ["", "! ST", "! ST boot=A1 WALK seq=1 hb=1 probe=0 q=1", "12 OK q=1"])
def test_what_is_no_status_is_none(broken: str) -> None:
    assert read_status(broken) is None


def test_a_greeting_tells_boot_joints_last_number_and_nonce() -> None:
    match = GREETING.fullmatch("0 OK TOUCH/1 boot=X9 joints=6 last=41 nonce=5f")

    assert match is not None
    assert match.groups() == ("X9", "6", "41", "5f")


@pytest.mark.parametrize(
    ("line", "parts"),
    [
        ("3 ACK", ("3", "ACK", None)),
        ("3 OK q=1,2", ("3", "OK", "q=1,2")),
        ("3 ERR LIMIT joint 2", ("3", "ERR", "LIMIT joint 2")),
    ],
)
def test_an_answer_has_its_number_its_kind_and_its_words(line: str, parts: tuple[str | None, ...]) -> None:
    match = ANSWER.fullmatch(line)

    assert match is not None
    assert match.groups() == parts


@given(st.integers(1, LAST_NUMBER))
def test_numbers_run_round_from_1_and_never_come_to_0(number: int) -> None:
    after = following(number)

    assert after == (number + 1 if number < 65535 else 1)
