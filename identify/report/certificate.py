"""The head and the foot of a report: what was calibrated, when, with what, and who stands for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from identify.model.io.calibration_file import Calibration
from identify.model.measurement import Measurements
from identify.model.touch import Touches
from identify.report.page import facts, table


@dataclass(frozen=True)
class Issue:
    """What a certificate says of itself, beside the calibration."""

    date: str = ""  # on which the report was made, YYYY-MM-DD
    operator: str = ""
    version: str = ""  # of touchcal


def head(c: Calibration, issue: Issue, tables: Sequence[Measurements]) -> str:
    """Title and facts: robot, serial number, date, operator, jig, wire, measurements."""
    robot, jig, wire = c.cell.robot, c.cell.jig, c.cell.wire
    entries = [
        ("robot", robot.name),
        ("serial no.", c.cell.serial),
        ("issued", issue.date),
        ("operator", issue.operator),
        ("measured", _period(tables)),
        ("jig", jig.name if jig else "none"),
        ("wire", f"{wire.shape}, radius {wire.radius:g} mm" if wire.radius else wire.shape),
        ("data", f"{len(c.residuals)} measurements, {len(c.estimated)} of {len(c.theta)} parameters estimated"),
        ("software", f"touchcal {issue.version}" if issue.version else ""),
    ]
    return f"<h1>Calibration of {escape(robot.name)}</h1>{facts(entries)}"


def _period(tables: Sequence[Measurements]) -> str:
    """The first and the last day of the touches, as far as their times were recorded."""
    days = sorted(time[:10] for table_ in tables if isinstance(table_, Touches) for time in table_.time if time)
    if not days:
        return ""
    return days[0] if days[0] == days[-1] else f"{days[0]} to {days[-1]}"


def foot(c: Calibration) -> str:
    """Hashes of the files that the result rests on, and lines to sign."""
    hashes = [[name, value] for name, value in {**c.inputs, **c.cell.sources}.items()]
    lines = "".join(f"<span>{name}</span>" for name in ("Place, date", "Calibrated by", "Approved by"))
    return f'{table(["file", "SHA-256"], hashes, (1,))}<div class="signatures">{lines}</div>'
