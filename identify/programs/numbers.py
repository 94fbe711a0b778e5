"""Numbers in a program, and how to write others in their place so that they look the same."""

import re
from dataclasses import dataclass

# no coordinate has sixteen digits before its point, nor an exponent of three: such numbers are mistakes
NUMBER = r"[+-]?(?:\d{1,15}(?!\d)\.?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?(?![\w.])"
WIDEST = 40
MOST = 12  # decimals that are ever written
_PARTS = re.compile(r"([+-]?)(\d*)\.?(\d*)(?:[eE]([+-]?\d+))?")


@dataclass(frozen=True)
class Number:
    """A number, and the spaces before it that it may use up or leave behind to keep its right edge."""

    start: int  # of the digits in the text
    end: int
    text: str
    lead: int = 0  # spaces just before `start`

    @property
    def value(self) -> float:
        """What it says."""
        return float(self.text)


def number(match: re.Match[str], group: int | str = 0, *, padded: bool = False) -> Number:
    """A number that a pattern has found; `padded` formats line numbers up at their right edge."""
    start = match.start(group)
    run = spaces_before(match.string, start)
    return Number(start, match.end(group), match[group], run if padded or run > 1 else 0)


def spaces_before(text: str, at: int) -> int:
    """How many spaces stand just before a place, WIDEST at most."""
    part = text[max(0, at - WIDEST) : at]
    return len(part) - len(part.rstrip(" "))


def decimals(text: str, least: int) -> int:
    """Decimals of a number as written, 1.5e-3 has four; not fewer than `least`."""
    _, _, fraction, exponent = _PARTS.fullmatch(text).groups()  # type: ignore[union-attr]
    return min(MOST, max(least, len(fraction) - int(exponent or 0)))


def same(text: str, value: float, least: int) -> bool:
    """Whether a number says a value to its own precision, so that its text may stay as it is."""
    return abs(float(text) - value) < 0.5 * 10.0 ** -decimals(text, least)


def written(old: Number, value: float, least: int, *, bare: bool = False) -> str:
    """A value in the style of the number it replaces: decimals, sign, leading zeros, right edge.

    `bare` formats write .5 for 0.5, unless the number replaced was written with its zero.
    """
    sign, whole, _, _ = _PARTS.fullmatch(old.text).groups()  # type: ignore[union-attr]
    digits = f"{abs(value):.{decimals(old.text, least)}f}"
    if digits.startswith("0.") and (not whole or (bare and not (whole == "0" and float(old.text)))):
        digits = digits[1:]
    elif len(whole) > 1 and whole.startswith("0"):
        digits = digits.rjust(len(digits) + max(0, len(whole) - len(digits.split(".")[0])), "0")
    negative = value < 0 and float(digits) != 0
    text = ("-" if negative else "+" if sign == "+" else "") + digits
    return text.rjust(max(old.lead + len(old.text), len(text) + 1)) if old.lead else text
