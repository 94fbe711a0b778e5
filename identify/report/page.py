"""One self-contained page: text, tables, charts and a 3-D view in a single file that needs no network."""

import json
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


def view(scene: dict[str, Any]) -> str:
    """The frame of the 3-D view, with the controls that step through the touches."""
    count = len(scene["touches"])
    if not count:
        return '<div id="view"></div><p id="said" class="soft">no touches to step through</p>'
    both = "identified" in scene["touches"][0]
    boxes = '<label><input type="checkbox" id="nominal" checked> nominal robot</label>'
    if both:
        boxes += ' <label><input type="checkbox" id="identified" checked> identified robot</label>'
    left = f" (the first {count}; {scene['left']} more in the file)" if scene["left"] else ""
    return (
        '<div id="view"></div><div class="controls">'
        '<button id="back" type="button">back</button><button id="next" type="button">next</button>'
        f'<input id="step" type="range" min="0" max="{count - 1}" value="0" aria-label="touch">{boxes}</div>'
        '<p id="said" class="soft"></p>'
        f'<p class="soft"><span class="screen">Drag to orbit, scroll to zoom, buttons step through the touches{left}. '
        "</span>Green: the weld zone.</p>"
    )


def table(header: list[str], rows: list[list[str]], words: tuple[int, ...] = ()) -> str:
    """A table of text, escaped; columns in `words` hold sentences."""
    top = "".join(f"<th>{escape(name)}</th>" for name in header)
    kind = ['<td class="words">' if i in words else "<td>" for i in range(len(header))]
    body = "".join(
        "<tr>" + "".join(f"{kind[i]}{escape(cell)}</td>" for i, cell in enumerate(row)) + "</tr>" for row in rows
    )
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'
