"""What the report says of joint errors that the touches chose, and of what residuals give away."""

from html import escape

from identify.model.io.calibration_file import Calibration
from identify.report.page import table


def chosen(c: Calibration) -> str:
    """What every joint error model buys in regions held out; nothing where the touches did not choose."""
    if not c.choice:
        return ""
    first = c.choice[0]
    alone = [["geometry alone", f"{first.held_out_mm + first.gain_mm:.3f}", "", "", ""]]
    rows = [
        [
            term.name,
            f"{term.held_out_mm:.3f}",
            f"{term.gain_mm:.4f}",
            f"{term.standard_error_mm:.4f}",
            "kept" if term.kept else "",
        ]
        for term in c.choice
    ]
    head = ["joint errors, one more a row", "mean held out, mm", "buys, mm", "+-", ""]
    return "<h2>Beyond geometry</h2>" + table(head, alone + rows, (4,))


def findings(c: Calibration) -> str:
    """Faults that residuals give away, with the evidence."""
    rows = [f for f in c.findings if f.kind != "outliers"]  # these have a table of their own
    items = "".join(f"<li><b>{escape(f.kind)}</b>: {escape(f.text)}</li>" for f in rows)
    return f"<ul>{items}</ul>" if rows else ""
