"""The report of a calibration: a verdict in words, what it rests on, and how to use it."""

from collections.abc import Sequence
from html import escape

import numpy as np

from identify.compensation.ladder import ladder
from identify.estimation.verification import Verification
from identify.model.io.calibration_file import Calibration, Errors, summarize
from identify.model.measurement import Measured
from identify.model.touch import Touches
from identify.report import charts
from identify.report.beyond import chosen, findings
from identify.report.certificate import Issue, foot, head
from identify.report.history import history
from identify.report.ladder import ways
from identify.report.page import folded, page, table, view
from identify.report.scene import scene
from identify.uncertainty.zone_map import ZoneMap, zone_map


def report(
    c: Calibration,
    measured: Sequence[Measured] = (),
    verified: Verification | None = None,
    *,
    issue: Issue | None = None,
    earlier: Sequence[tuple[str, Calibration]] = (),
) -> str:
    """A self-contained HTML page: the certificate of a calibration.

    `measured` are the measurements it was made from, for the view and the faces; `earlier` calibrations of the same
    robot, by the names of their files, show what has changed since.
    """
    zone = zone_map(c)
    faces = {name: face for t in measured if isinstance(t, Touches) for name, face in zip(t.ids, t.face, strict=True)}
    shown = _scene(c, measured)
    sections = [
        head(c, issue or Issue(), measured),
        _verdict(c, zone, verified),
        "<h2>Accuracy</h2>", _accuracy(c, verified),
        "" if zone is None else f"<h2>Expected tip error in the weld zone</h2>{charts.zone_slices(zone)}{ZONE}",
        "<h2>Robot, jig and touches</h2>", view(shown),
        history(c, earlier),
        "<h2>Residuals</h2>",
        f'<div class="row figures">{charts.residuals_by_face(c, faces)}{charts.residuals_in_time(c)}</div>',
        findings(c), _outliers(c), chosen(c),
        f'<h2>Parameters</h2><div class="columns">{_parameters(c)}</div>',
        folded("How well each direction is seen, and correlations",
               f'<div class="row">{charts.singular_values(c)}{charts.correlations(c)}</div>'),
        "<h2>How to apply it</h2>", APPLY, ways(ladder(c)), SCALE,
        "<h2>Where it comes from</h2>", foot(c),
    ]  # fmt: skip
    return page(f"Calibration of {c.cell.robot.name}", "\n".join(sections), shown)


ZONE = """<p class="soft">Torch straight down, best branch of the arm; grey is out of reach. A prediction, not a
measurement.</p>"""
APPLY = """<p>The identified robot differs from the controller's in every link. Three ways lead from here, better
ones first:</p>
<ul><li>let the off-line programming system use the calibrated model, and correct its targets through it;</li>
<li>correct finished programs point by point;</li>
<li>enter joint zeros and tool into the controller: the easiest, and it leaves the errors of the links.</li></ul>"""
SCALE = """<p>Accuracy is relative to the jig, whose certificate sets the scale. The torch's orientation is not
verified by touches.</p>"""


def _verdict(c: Calibration, zone: ZoneMap | None, verified: Verification | None) -> str:
    """One sentence that a welder can use."""
    if verified is not None:
        good = verified.identified.p95_mm <= 1.2 * verified.promised_p95_mm
        e = verified.identified
        words = (
            f"At {e.n} places that the fit has not seen, the tip is off by {e.mean_mm:.2f} mm on average and by "
            f"{e.p95_mm:.2f} mm in 95 % of them; before it was {verified.nominal.mean_mm:.2f} mm. Promised were "
            f"{verified.promised_p95_mm:.2f} mm: {'kept' if good else 'NOT kept, the model lacks something'}."
        )
    elif zone is not None and np.isfinite(zone.error).any():
        good = not c.scatter_significant or c.scatter < 2
        words = (
            f"The tip is expected to be off by {np.nanmedian(zone.error):.2f} mm (RMS) in the middle of the weld zone "
            f"and by {np.nanmax(zone.error):.2f} mm at worst. This is a prediction; verify it with touches "
            "that were not used."
        )
    else:
        good, words = True, "No zone is given and nothing was verified: there is no accuracy to state."
    return f'<p class="verdict{"" if good else " bad"}">{escape(words)}</p>'


def _accuracy(c: Calibration, verified: Verification | None) -> str:
    before = summarize(np.array([r.before_mm for r in c.residuals.values() if r.used]))
    rows: list[tuple[str, Errors | None, str]] = [
        ("nominal robot, at the touches", before, "before"),
        ("identified robot, at the touches", c.fit, "no accuracy: the fit has seen them"),
        ("regions held out in turn", c.held_out, "an honest estimate between the touches"),
    ]
    if verified:
        rows += [
            ("nominal robot, unseen", verified.nominal, ""),
            ("identified robot, unseen", verified.identified, "accuracy"),
        ]
    text = [
        [
            name,
            *(["-"] * 5 if e is None else [str(e.n), *(f"{v:.3f}" for v in (e.mean_mm, e.rms_mm, e.p95_mm, e.max_mm))]),
            words,
        ]
        for name, e, words in rows
    ]
    return table(["", "n", "mean, mm", "RMS, mm", "95 %, mm", "max, mm", ""], text, (6,))


def _scene(c: Calibration, measured: Sequence[Measured]) -> dict[str, object]:
    ids = tuple(name for t in measured for name in t.ids)
    faces = tuple(face for t in measured for face in (t.face if isinstance(t, Touches) else ("",) * len(t)))
    q = np.concatenate([t.q for t in measured]) if measured else np.empty((0, len(c.cell.robot.joints)))
    words = tuple(
        f"{c.residuals[name].before_mm:+.2f} mm before, {c.residuals[name].after_mm:+.3f} mm after"
        if name in c.residuals
        else ""
        for name in ids
    )
    return scene(c.cell, c.theta, ids, faces, q, words)


def _outliers(c: Calibration) -> str:
    if not c.outliers:
        return "<p>No touch disagrees with the others.</p>"
    return "<p>Left out, because they disagree with all others:</p>" + table(
        ["touch", "residual, mm"], [[name, f"{r:+.3f}"] for name, r in c.outliers.items()]
    )


def _parameters(c: Calibration) -> str:
    unit, names = c.cell.robot.parameter_unit(), c.cell.robot.parameters
    rows = []
    for i, name in enumerate(names):
        status, sigma = c.status(name), 1.96 * c.sigma[i] / unit[i]
        sight = {
            "estimated": "weak: tolerances tell more" if name in c.weak else "well seen",
            "fixed": "fixed by the user",
        }
        words = sight.get(status) or _carried(c, name)
        value, start = c.theta[i] / unit[i], c.start[i] / unit[i]
        known, digits = status == "estimated", c.cell.robot.decimals[i]
        rows.append([
            f"{name} [{c.cell.robot.units[i]}]", f"{start:.{digits}f}", f"{value:.{digits}f}" if known else "",
            f"{value - start:+.{digits}f}" if known else "", f"{sigma:.{digits}f}" if known else "", words,
        ])  # fmt: skip
    return table(["parameter", "start", "identified", "change", "+- (95 %)", ""], rows, (5,))


def _carried(c: Calibration, name: str) -> str:
    terms = c.combinations.get(name, {})
    if not terms:
        return "eliminated: no effect on the tip"
    return "eliminated, carried by " + ", ".join(f"{value:+.4g} {kept}" for kept, value in terms.items())
