"""The page for the operator: what to set, how to load the program, how to run it, and what comes back."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from probe.programs.options import UNTRIED, Options
from probe.programs.part import FAILURES, STUCK, Part


@dataclass(frozen=True)
class Instructions:
    """What to tell an operator of a maker's controllers; {input}, {first} and the like are filled in."""

    title: str
    prepare: tuple[str, ...]  # what to set before
    load: tuple[str, ...]  # how the files get into the controller
    save: tuple[str, ...]  # what comes back, and what it is called
    overwrites: str  # what the program writes over
    slowly: str = "in T1 at 10 % override, with the deadman in your hand"  # the first time
    unproven: str = ""  # what stands in the manual, and not in two public programs


def page(
    instructions: Instructions, signal: str, parts: Sequence[Part], options: Options, notes: Sequence[str] = ()
) -> str:
    """The page as Markdown; `signal` is the usual touch input, `notes` stand before all else that is to be set."""
    return "\n".join([*_page(instructions, signal, parts, options, notes), ""])


def _page(
    maker: Instructions, signal: str, parts: Sequence[Part], options: Options, notes: Sequence[str]
) -> Iterator[str]:
    touches, kind = sum(len(part.routines) for part in parts), "rehearsal" if options.rehearsal else "touches"
    words = {
        "input": options.input or signal,
        "host": options.host,
        "port": options.port,
        "first": options.first,
        "zero": options.first - 1,
        "last": options.first + 2 + 2 * max(len(part.routines) for part in parts),
        "numbers": options.first + 9 + 7 * max(len(part.routines) for part in parts),
    }
    yield from (f"# {maker.title}: {touches} {kind} in {len(parts)} file{'s' if len(parts) > 1 else ''}", "")
    yield f"**{UNTRIED}** Its statements follow the maker's manuals and public programs; an interpreter of them, not a"
    yield from ("controller, has run it. Read it before you run it, and keep a hand on the stop.", "")
    if maker.unproven and not options.rehearsal:
        yield from (f"**{maker.unproven}** Check the first touches: the joints that it logs against the pendant.", "")
    yield from ("## Before", "")
    yield from (f"* **{note}**" for note in notes)
    yield from (f"* {text.format(**words)}" for text in maker.prepare)
    yield "* The torch, the jig and the table stand as cell.yaml says; nothing else is in the way between the touches."
    yield "* The wire is cut where tool: of cell.yaml puts its tip, and the torch does not feed."
    yield f"* The program overwrites {maker.overwrites.format(**words)}: back up what you need of it."
    posture = ", ".join(f"{value:.1f}" for value in parts[0].counts(parts[0].routines[0].legs[0].q))
    yield "* Jog the robot above the jig, near the first posture, whole turns of joints included: the first motion goes"
    yield f"  straight there. Its joints are {posture}."
    yield from ("", "## Load", "")
    yield from (f"* {text.format(**words)}" for text in maker.load)
    yield from ("", "## Run", "")
    yield f"* First {maker.slowly}, at least the first five touches."
    yield "* First the rehearsal (touchcal program ... --rehearsal): every approach from further off, no search."
    if not options.rehearsal:
        yield "* Then the touches. Search at 100 % override: touches come late by speed times delay, here at"
        yield f"  {parts[0].speed:g} mm/s."
        yield f"* After {FAILURES} touches in a row without a contact it stops: is the jig where the cell says?"
        yield f"* It stops as well where the input stays closed for {STUCK:g} s: free the wire."
        yield "* Start goes on with the next touch; a touch that failed is left out, and import says why."
    yield from ("", "| file | touches |", "|---|---|")
    yield from (f"| {part.name} | {part.routines[0].id} to {part.routines[-1].id} |" for part in parts)
    if not options.rehearsal:
        yield from ("", "## After", "")
        yield from (f"* {text.format(**words)}" for text in maker.save)
