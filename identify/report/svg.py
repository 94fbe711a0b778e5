"""Charts as inline SVG: axes with units, a legend, and colours that survive a printer."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape

import numpy as np
from jaxtyping import Float

# colours of the page, which follow its theme; files of their own take the ones behind the comma
BEFORE, AFTER, OUT = "var(--before, #b0752c)", "var(--after, #1f6fb2)", "var(--out, #c0392b)"
NOTHING = "var(--nothing, #ddd)"
MARGIN = (46, 18, 26, 58)  # bottom, right, top, left
MOST = 8  # decades that are labelled on one axis, about
SCALE = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))  # dark to light: small to large


@dataclass(frozen=True)
class Axis:
    """One axis of a chart: what is on it, in which unit, from where to where."""

    title: str
    lower: float
    upper: float
    ticks: tuple[float, ...]
    labels: tuple[str, ...] = ()
    powers: bool = False  # the axis holds logarithms to base 10

    def scaled(self, value: Float[np.ndarray, " values"]) -> Float[np.ndarray, " values"]:
        """Values as they stand on the axis."""
        return np.log10(np.maximum(value, 1e-300)) if self.powers else value

    def at(self, value: Float[np.ndarray, " values"], start: float, end: float) -> Float[np.ndarray, " values"]:
        """Values as places between two pixels."""
        return start + (value - self.lower) / (self.upper - self.lower) * (end - start)


def axis(title: str, values: Sequence[float] | np.ndarray, *, zero: bool = False) -> Axis:
    """An axis around values, with ticks at round numbers."""
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    lower, upper = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    lower = min(lower, 0.0) if zero else lower
    if upper - lower < 1e-12:
        lower, upper = lower - 0.5, upper + 0.5
    step = 10 ** np.floor(np.log10((upper - lower) / 4))
    step = next(step * k for k in (1, 2, 5, 10) if (upper - lower) / (step * k) <= 6)
    first, last = np.floor(lower / step + 1e-9), np.ceil(upper / step - 1e-9)
    ticks = step * np.arange(first, last + 1)
    return Axis(title, float(ticks[0]), float(ticks[-1]), tuple(ticks.tolist()), tuple(f"{t:.6g}" for t in ticks + 0.0))


def logarithmic(title: str, values: Sequence[float] | np.ndarray) -> Axis:
    """A logarithmic axis around positive values: ticks at 1, 2 and 5 of few decades, or at every so many of many."""
    positive = np.asarray(values, dtype=float)
    positive = positive[np.isfinite(positive) & (positive > 0)]
    low, high = (np.log10(positive.min()), np.log10(positive.max())) if len(positive) else (0.0, 1.0)
    digits = (1, 2, 5) if high - low < 3 else (1,)
    every = max(1, int(np.ceil((high - low) / MOST)))  # decades from label to label
    decades = np.arange(np.floor(low / every) - 1, np.ceil(high / every) + 2) * every
    ticks = np.log10([d * 10.0**e for e in decades for d in digits])
    first, last = ticks[ticks <= low + 1e-9][-1], ticks[ticks >= high - 1e-9][0]
    last = last if last > first else ticks[ticks > first][0]
    inside = ticks[(ticks >= first) & (ticks <= last)]
    return Axis(title, first, last, tuple(inside.tolist()), tuple(map(_power, inside)), powers=True)


def _power(exponent: float) -> str:
    """Ten to the power of an exponent, short."""
    if -3.1 < exponent < 4.9:
        return f"{10**exponent:.5g}"
    return re.sub(r"e\+?(-?)0*", r"e\1", f"{10**exponent:.0e}")


def around(axis: Axis, step: float) -> Axis:
    """The axis with half a step more on both sides, for cells that stand around their values."""
    return replace(axis, lower=axis.lower - step / 2, upper=axis.upper + step / 2)


def named(title: str, names: Sequence[str]) -> Axis:
    """An axis of names, one unit each."""
    return Axis(title, -0.5, len(names) - 0.5, tuple(float(i) for i in range(len(names))), tuple(names))


class Chart:
    """A chart being drawn; places are in pixels, y downwards."""

    def __init__(
        self, title: str, x: Axis, y: Axis, width: int = 520, height: int = 280, slanted: bool = False
    ) -> None:
        bottom, right, top, left = MARGIN
        self.title, self.x, self.y, self.width, self.height = title, x, y, width, height + (46 if slanted else 0)
        self.left, self.right, self.top, self.bottom = left, width - right, top, height - bottom
        self.parts: list[str] = []
        self._frame(slanted)

    def _frame(self, slanted: bool) -> None:
        for place, label in zip(self.px(np.array(self.x.ticks)), self.x.labels, strict=True):
            turn = f' transform="rotate(-40 {place:.1f} {self.bottom + 14})" text-anchor="end"' if slanted else ""
            anchor = "" if slanted else ' text-anchor="middle"'
            self.parts.append(f'<text x="{place:.1f}" y="{self.bottom + 14}"{anchor}{turn}>{escape(label)}</text>')
        for place, label in zip(self.py(np.array(self.y.ticks)), self.y.labels, strict=True):
            self.parts.append(
                f'<line class="grid" x1="{self.left}" x2="{self.right}" y1="{place:.1f}" y2="{place:.1f}"/>'
            )
            self.parts.append(f'<text x="{self.left - 6}" y="{place + 4:.1f}" text-anchor="end">{escape(label)}</text>')
        middle, upright = (self.left + self.right) / 2, (self.top + self.bottom) / 2
        wide, high = self.right - self.left, self.bottom - self.top
        aside = f'transform="rotate(-90 14 {upright:.0f})" x="14" y="{upright:.0f}" text-anchor="middle"'
        self.parts += [
            f'<rect class="frame" x="{self.left}" y="{self.top}" width="{wide}" height="{high}"/>',
            f'<text x="{middle:.0f}" y="{self.height - 6}" text-anchor="middle">{escape(self.x.title)}</text>',
            f"<text {aside}>{escape(self.y.title)}</text>",
        ]

    def px(self, value: np.ndarray) -> np.ndarray:
        """Places of values along x."""
        return self.x.at(value, self.left, self.right)

    def py(self, value: np.ndarray) -> np.ndarray:
        """Places of values along y."""
        return self.y.at(value, self.bottom, self.top)

    def dots(self, x: np.ndarray, y: np.ndarray, colour: str, hints: Sequence[str], size: float = 3) -> None:
        """Points, with a hint under the pointer."""
        for u, v, hint in zip(self.px(x), self.py(y), hints, strict=True):
            self.parts.append(
                f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{size}" fill="{colour}"><title>{escape(hint)}</title></circle>'
            )

    def line(self, x: np.ndarray, y: np.ndarray, colour: str, dashed: bool = False) -> None:
        """A line through points."""
        places = " ".join(f"{u:.1f},{v:.1f}" for u, v in zip(self.px(x), self.py(y), strict=True))
        dash = ' stroke-dasharray="5 3"' if dashed else ""
        self.parts.append(f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="1.6"{dash}/>')

    def bars(self, x: np.ndarray, y: np.ndarray, colour: str, hints: Sequence[str]) -> None:
        """Bars from the lower end of the y axis."""
        wide = 0.7 * (self.right - self.left) / (self.x.upper - self.x.lower)
        for u, v, hint in zip(self.px(x), self.py(y), hints, strict=True):
            self.parts.append(
                f'<rect x="{u - wide / 2:.1f}" y="{v:.1f}" width="{wide:.1f}" height="{max(self.bottom - v, 0):.1f}" '
                f'fill="{colour}"><title>{escape(hint)}</title></rect>'
            )

    def cells(
        self, x: np.ndarray, y: np.ndarray, size: tuple[float, float], colours: Sequence[str], hints: Sequence[str]
    ) -> None:
        """Rectangles around points, in units of the axes."""
        wide = abs(float(self.px(np.array([size[0]]))[0] - self.px(np.zeros(1))[0]))
        high = abs(float(self.py(np.array([size[1]]))[0] - self.py(np.zeros(1))[0]))
        for u, v, shade, hint in zip(self.px(x), self.py(y), colours, hints, strict=True):
            place = f'x="{u - wide / 2:.1f}" y="{v - high / 2:.1f}" width="{wide + 0.3:.1f}" height="{high + 0.3:.1f}"'
            self.parts.append(f'<rect {place} fill="{shade}"><title>{escape(hint)}</title></rect>')

    def level(self, y: float, text: str) -> None:
        """A dashed line across the chart, with its meaning."""
        place = float(self.py(np.array([y]))[0])
        self.parts.append(f'<line class="level" x1="{self.left}" x2="{self.right}" y1="{place:.1f}" y2="{place:.1f}"/>')
        self.parts.append(f'<text class="over" x="{self.left + 4}" y="{place - 4:.1f}">{escape(text)}</text>')

    def legend(self, entries: Sequence[tuple[str, str]]) -> None:
        """Colours and what they mean, above the chart."""
        place = float(self.left)
        for colour, text in entries:
            self.parts.append(f'<circle cx="{place + 5:.0f}" cy="{self.top - 14}" r="4" fill="{colour}"/>')
            self.parts.append(f'<text x="{place + 13:.0f}" y="{self.top - 10}">{escape(text)}</text>')
            place += 26 + 6.3 * len(text)

    def __str__(self) -> str:
        title, box = escape(self.title), f"0 0 {self.width} {self.height}"
        picture = f'<svg viewBox="{box}" role="img" aria-label="{title}">{"".join(self.parts)}</svg>'
        narrow = ' class="narrow"' if self.width < 200 else ""
        return f"<figure{narrow}><figcaption>{title}</figcaption>{picture}</figure>"


def picture(chart: Chart) -> str:
    """A chart as an SVG file of its own, with its title above it."""
    title, high = escape(chart.title), chart.height + 22
    style = (
        "text { font: 11px system-ui, sans-serif; fill: #222 } .frame { fill: none; stroke: #888 } "
        ".over { paint-order: stroke; stroke: #fff; stroke-width: 3px } .grid { stroke: #ddd } "
        ".level { stroke: #888; stroke-dasharray: 4 3 } .title { font-size: 12px }"
    )
    body = re.sub(r"var\(--\w+, (#\w+)\)", r"\1", "".join(chart.parts))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {chart.width} {high}" width="{chart.width}" '
        f'height="{high}" role="img" aria-label="{title}"><style>{style}</style><rect width="100%" height="100%" '
        f'fill="#fff"/><text class="title" x="{chart.width / 2:.0f}" y="14" text-anchor="middle">{title}</text>'
        f'<g transform="translate(0 22)">{body}</g></svg>\n'
    )


def colour(share: Float[np.ndarray, " values"]) -> list[str]:
    """Colours of values between 0 and 1, dark to light; grey where there is none."""
    anchors = np.array(SCALE)
    place = np.clip(np.nan_to_num(share), 0, 1) * (len(anchors) - 1)
    low = np.minimum(place.astype(int), len(anchors) - 2)
    mixed = anchors[low] + (place - low)[:, None] * (anchors[low + 1] - anchors[low])
    return [
        NOTHING if np.isnan(s) else "rgb({:.0f},{:.0f},{:.0f})".format(*m) for s, m in zip(share, mixed, strict=True)
    ]


def diverging(value: Float[np.ndarray, " values"]) -> list[str]:
    """Colours of values between -1 and 1: blue, white, red."""
    cold, warm = np.array([31, 111, 178]), np.array([192, 57, 43])
    strength = np.abs(np.clip(value, -1, 1))[:, None]
    mixed = 255 + strength * (np.where(value[:, None] < 0, cold, warm) - 255)
    return ["rgb({:.0f},{:.0f},{:.0f})".format(*m) for m in mixed]
