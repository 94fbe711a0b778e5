"""One self-contained page: text, tables, charts and a 3-D view in a single file that needs no network."""

import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Any


def page(title: str, body: str, scene: dict[str, Any]) -> str:
    """The HTML of a page; `body` is HTML already, everything in `scene` is data."""
    here = files("identify.report")
    # in a script element only "</" and "<!--" could end the data early
    data = json.dumps(scene).replace("<", "\\u003c")
    return Template((here / "page.html").read_text(encoding="utf-8")).substitute(
        title=escape(title),
        body=body,
        scene=data,
        three=(here / "three.min.js").read_text(encoding="utf-8").replace("</script", "<\\/script"),
        script=(here / "page.js").read_text(encoding="utf-8"),
    )


def view(scene: dict[str, Any], steps: str = "touches") -> str:
    """The frame of the 3-D view, with the controls that step through the touches, or what else the `steps` are."""
    count = len(scene["touches"])
    frame = '<div id="view" tabindex="0" role="group" aria-label="3-D view; arrow keys turn it"></div>'
    if not count:
        return f'{frame}<p id="caption" class="soft">no {steps} to step through</p>'
    both = "identified" in scene["touches"][0]
    boxes = '<label><input type="checkbox" id="nominal" checked> nominal robot</label>'
    if both:
        boxes += ' <label><input type="checkbox" id="identified" checked> identified robot</label>'
    if "paths" in scene:
        boxes += ' <label><input type="checkbox" id="paths" checked> paths between touches</label>'
    remainder = f" (the first {count}; {scene['left']} more in the file)" if scene["left"] else ""
    return (
        f'{frame}<div class="controls">'
        '<button id="back" type="button">back</button><button id="next" type="button">next</button>'
        f'<input id="step" type="range" min="0" max="{count - 1}" value="0" aria-label="touch">{boxes}</div>'
        '<p id="caption" class="soft" aria-live="polite"></p>'
        '<p class="soft"><span class="screen">Drag or arrow keys turn the view, scroll or + and - zoom, buttons or '
        f"page keys step through the {steps}{remainder}. </span>Green: the weld zone.</p>"
    )


def table(header: Sequence[str], rows: Sequence[Sequence[str]], words: tuple[int, ...] = ()) -> str:
    """A table of text, escaped; columns in `words` hold sentences. On a narrow screen each row becomes a card."""
    kind = [' class="words"' if i in words else "" for i in range(len(header))]
    top = "".join(f'<th scope="col"{kind[i]}>{escape(name)}</th>' for i, name in enumerate(header))
    cells = [f'<td{kind[i]} data-head="{escape(name)}">' for i, name in enumerate(header)]
    body = "".join(
        "<tr>" + "".join(f"{cells[i]}{escape(cell)}</td>" for i, cell in enumerate(row)) + "</tr>" for row in rows
    )
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def folded(summary: str, content: str) -> str:
    """Content that the reader unfolds; it is not printed."""
    return f"<details><summary>{escape(summary)}</summary>{content}</details>"


def facts(entries: Sequence[tuple[str, str]]) -> str:
    """Names and values, side by side; those without a value are left out."""
    rows = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in entries if value)
    return f"<dl>{rows}</dl>"
