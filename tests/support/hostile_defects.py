"""Defects of a driver, planted to see that the judge of the hostile bench finds them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

from probe.controllers.grbl import Grbl
from probe.controllers.line import Line
from probe.line.controller import Contact
from probe.line.link import Link
from probe.line.retry import Timing
from probe.runs import attempt
from probe.runs.attempt import Motion
from probe.runs.retreat import Retreat
from probe.runs.session import Session


@dataclass(frozen=True)
class Defect:
    """What a driver does wrong, and what the judge has to say of it."""

    backend: str
    seed: int  # of a schedule in which it shows
    verdict: str
    plant: Callable[[], Any]  # a context


def _stops_where_it_rests() -> Any:
    search = Line.search

    def searched(self: Line, q: Any, rate: float) -> Any:
        found = search(self, q, rate)
        return replace(found, q=found.stop) if isinstance(found, Contact) else found

    return patch.object(Line, "search", searched)


def _writes_twice() -> Any:
    finish = Session.finish

    def finished(self: Session, result: Any) -> None:
        finish(self, result)
        finish(self, replace(result, id=f"{result.id}~2"))

    return patch.object(Session, "finish", finished)


@contextmanager
def _believes_any_contact() -> Iterator[None]:
    nothing = lambda *evidence: ""  # noqa: E731
    with patch.object(attempt, "objection", nothing), patch.object(attempt, "unconfirmed", nothing):
        yield


def _looks_no_more() -> Any:
    observe = Retreat._observe

    def observed(self: Retreat, place: str, state: Any) -> None:
        observe(self, place, replace(state, contact=place == "contact"))

    return patch.object(Retreat, "_observe", observed)


def _stays_in_contact() -> Any:
    return patch.object(Motion, "retreat", lambda self: None)


def _does_not_stop() -> Any:
    return patch.object(Link, "halt", lambda self: None)


def _waits_for_ever() -> Any:
    return patch.object(Timing, "of", classmethod(lambda cls, clock: cls(silence=60.0, patience=100.0)))


def _trusts_the_line() -> Any:
    return patch.object(Grbl, "_understood", lambda self, target: self.link.told("G21") is not None)


@contextmanager
def _counts_in_contact() -> Iterator[None]:
    with _stays_in_contact(), patch.object(attempt, "unconfirmed", lambda evidence, search: ""):
        yield


DEFECTS = {
    "the place where it came to rest is taken for the latch": Defect("line", 0, "wrong touch", _stops_where_it_rests),
    "every row is written twice": Defect("line", 0, "doubled", _writes_twice),
    "any contact counts": Defect("line", 32, "wrong touch", _believes_any_contact),
    "the input is not looked at": Defect("line", 32, "wrong touch", _looks_no_more),
    "a touch counts before the retract": Defect("line", 0, "without evidence", _counts_in_contact),
    "the robot goes on from the contact": Defect("line", 0, "was not the retract", _stays_in_contact),
    "a stop is not sent": Defect("line", 4, "still moved when stop", _does_not_stop),
    "a silent line is waited for": Defect("line", 11, " took ", _waits_for_ever),
    "a target goes unchecked": Defect("grbl", 13, "astray", _trusts_the_line),
}
