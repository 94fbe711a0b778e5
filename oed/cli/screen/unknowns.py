"""What was measured and identified, as `touchcal identify` prints it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from identify.model.io.calibration_file import Calibration
    from identify.model.measurement import Measurements


def parameter_lines(c: "Calibration") -> list[str]:
    """Changes and 95 % intervals of the estimated parameters; joint errors whose interval holds zero are counted."""
    from identify.uncertainty.promise import INTERVAL

    robot, unit = c.cell.robot, c.cell.robot.parameter_unit()
    lines = [f"{'parameter':16}{'start':>12}{'identified':>12}{'change':>10}{'+- (95 %)':>11}"]
    joint_errors = {parameter for parameter, _, _ in robot.error_parameters}
    small = [i for i in c.index if robot.parameters[i] in joint_errors and abs(c.theta[i]) < INTERVAL * c.sigma[i]]
    for i in sorted(set(c.index).difference(small)):
        start, value, sigma = c.start[i] / unit[i], c.theta[i] / unit[i], c.sigma[i] / unit[i]
        name = f"{robot.parameters[i]} {robot.units[i]}"
        digits = robot.decimals[i]
        numbers = ((start, 12), (value, 12), (value - start, 10), (INTERVAL * sigma, 11))
        lines.append(f"{name:16}" + "".join(f"{x:{width}.{digits}f}" for x, width in numbers))
    if small:
        lines.append(f"{len(small)} joint errors are zero within their uncertainty; calibration.json holds them all")
    return lines


def kind_lines(tables: Sequence["Measurements"]) -> list[str]:
    """Measurements of each kind, and the further placements and tools that they name, if they are not touches alone."""
    from identify.model.measurement import MEASUREMENTS

    words = [
        f"{len(table)} of kind {kind}"
        + "".join(
            f", {column} {', '.join(names)}"
            for column in ("placement", "tool")
            if (names := sorted({*(getattr(table, column) or ())} - {""}))
        )
        for table in tables
        for kind, entry in MEASUREMENTS.items()
        if isinstance(table, entry.table)
    ]
    return [] if all(" of kind touch" in w and "," not in w for w in words) else ["; ".join(words)]


def shared_lines(c: "Calibration") -> list[str]:
    """Further placements, tools and points with their 95 % intervals."""
    from identify.uncertainty.promise import INTERVAL

    return [
        f"{f'{s.name} {s.unit}':28}{s.value / s.inside:12.4f}{'+-':>10}{INTERVAL * sigma / s.inside:11.4f}"
        for s, sigma in c.named
    ]
