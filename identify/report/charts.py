"""What the numbers of a calibration look like."""

from collections.abc import Mapping

import numpy as np

from identify.model.io.calibration_file import Calibration
from identify.report.svg import AFTER, BEFORE, OUT, Axis, Chart, around, axis, colour, diverging, named
from identify.uncertainty.zone_map import ZoneMap

LEAST = 0.2  # of the largest error: the colours of the zone span at least so much of it


def residuals_in_time(c: Calibration) -> str:
    """Residuals in the order of the touches: a drift is a slope."""
    order = np.arange(1, len(c.residuals) + 1)
    after = np.array([r.after_mm for r in c.residuals.values()])
    counted = np.array([r.used for r in c.residuals.values()])
    chart = Chart(
        "Residuals after identification, in the order of the touches",
        axis("touch", order),
        axis("residual, mm", after[counted], zero=True),
    )
    inside = np.clip(after, chart.y.lower, chart.y.upper)
    hints = [f"{name}: {value:+.3f} mm" for name, value in zip(c.residuals, after, strict=True)]
    for mask, shade in ((counted, AFTER), (~counted, OUT)):
        chart.dots(order[mask], inside[mask], shade, [h for h, m in zip(hints, mask, strict=True) if m])
    chart.level(0.0, "")
    chart.legend([(AFTER, "used"), (OUT, "left out; beyond the frame at its edge")])
    return str(chart)


def residuals_by_face(c: Calibration, faces: Mapping[str, str]) -> str:
    """Sizes of residuals on each face before and after, on a logarithmic scale; `faces` gives the face of a touch."""
    names = list(dict.fromkeys(faces.get(name, "") or "plane" for name in c.residuals))
    place = np.array([names.index(faces.get(name, "") or "plane") for name in c.residuals], dtype=float)
    before, after = (np.abs([getattr(r, key) for r in c.residuals.values()]) for key in ("before_mm", "after_mm"))
    decades = np.arange(-4, 3)
    y = Axis("size of the residual, mm", -4, 2, tuple(map(float, decades)), tuple(f"{10.0**d:g}" for d in decades))
    chart = Chart("Residuals by face, before and after", named("", names), y, slanted=True)
    for shift, values, shade in ((-0.17, before, BEFORE), (0.17, after, AFTER)):
        hints = [f"{name}: {v:.3f} mm" for name, v in zip(c.residuals, values, strict=True)]
        chart.dots(place + shift, np.log10(np.clip(values, 1e-4, 100)), shade, hints, 2.5)
    chart.legend([(BEFORE, "nominal robot"), (AFTER, "identified robot")])
    return str(chart)


def correlations(c: Calibration) -> str:
    """Correlations of the estimated parameters: red pairs rise together, blue pairs make up for each other."""
    deviation = np.sqrt(np.diag(c.covariance))
    R = c.covariance / np.outer(deviation, deviation)
    n = len(R)
    x = Axis("", -0.5, n - 0.5, tuple(map(float, range(n))), c.estimated)
    y = Axis("", n - 0.5, -0.5, tuple(map(float, range(n))), c.estimated)
    chart = Chart("Correlations of the estimated parameters (blue -1, white 0, red +1)", x, y, 560, 520, slanted=True)
    rows, columns = np.indices(R.shape)
    hints = [
        f"{c.estimated[i]}, {c.estimated[j]}: {R[i, j]:+.2f}"
        for i, j in zip(rows.ravel(), columns.ravel(), strict=True)
    ]
    chart.cells(columns.ravel().astype(float), rows.ravel().astype(float), (1.0, 1.0), diverging(R.ravel()), hints)
    return str(chart)


def singular_values(c: Calibration) -> str:
    """How well each direction is seen, in units of what was known before: below 1, the tolerances tell more."""
    scale = c.cell.scale[c.index]
    s = 1 / np.sqrt(np.maximum(np.linalg.eigvalsh(c.covariance / np.outer(scale, scale)), 1e-300))
    size = np.log10(s)
    low, high = min(int(np.floor(size.min())), 0), max(int(np.ceil(size.max())), 1)
    decades = np.arange(low, high + 1)
    y = Axis(
        "prior / posterior deviation", low, high, tuple(map(float, decades)), tuple(f"{10.0**d:g}" for d in decades)
    )
    x = axis("direction, best seen first", np.arange(1, len(s) + 1))
    chart = Chart(
        "What the touches tell about each direction of the parameters",
        Axis(x.title, 0, len(s) + 1, x.ticks[1:], x.labels[1:]),
        y,
    )
    chart.bars(
        np.arange(1.0, len(s) + 1),
        size,
        AFTER,
        [f"direction {i + 1}: {v:.3g} times better known" for i, v in enumerate(s)],
    )
    chart.level(0.0, "as well as before")
    return str(chart)


def zone_slices(zone: ZoneMap) -> str:
    """Predicted tip error over slices of the weld zone; the colours run from the smallest to the largest."""
    finite = zone.error[np.isfinite(zone.error)]
    high = float(finite.max(initial=0.0)) or 1.0
    span = (min(float(finite.min(initial=high)), (1 - LEAST) * high), high)
    parts = [_slice(zone, k, span) for k in range(len(zone.z))]
    return '<div class="row maps">' + "".join(parts) + _scale(span) + "</div>"


def _slice(zone: ZoneMap, k: int, span: tuple[float, float]) -> str:
    X, Y = np.meshgrid(zone.x, zone.y, indexing="ij")
    error = zone.error[:, :, k].ravel()
    step = (zone.x[1] - zone.x[0], zone.y[1] - zone.y[0])
    x, y = around(axis("x, mm", zone.x), step[0]), around(axis("y, mm", zone.y), step[1])
    chart = Chart(f"z = {zone.z[k]:.0f} mm", x, y, 300, 260)
    places = zip(X.ravel(), Y.ravel(), error, strict=True)
    hints = ["out of reach" if np.isnan(e) else f"({u:.0f}, {v:.0f}): {e:.3f} mm" for u, v, e in places]
    chart.cells(X.ravel(), Y.ravel(), step, colour((error - span[0]) / (span[1] - span[0])), hints)
    return str(chart)


def _scale(span: tuple[float, float]) -> str:
    """The colours and what they mean."""
    low, high = span
    values = np.linspace(low, high, 40)
    ticks = np.linspace(low, high, 5)
    y = Axis("expected tip error (RMS), mm", low, high, tuple(ticks.tolist()), tuple(f"{t:.3f}" for t in ticks))
    chart = Chart("scale", Axis("", -0.5, 0.5, (), ()), y, 120, 260)
    chart.cells(np.zeros(40), values, (1.0, (high - low) / 39), colour(np.linspace(0, 1, 40)), ["" for _ in values])
    return str(chart)
