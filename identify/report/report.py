"""The report of a calibration: a verdict in words, what it rests on, and how to use it."""

from collections.abc import Sequence
from html import escape

import numpy as np

from identify.compensation.ladder import ladder
from identify.estimation.verdict import with_promise
from identify.estimation.verification import Verification, beyond_in_zone
from identify.model.io.calibration_file import Calibration, Errors, summarize
from identify.model.measurement import Measurements
from identify.model.touch import Touches
from identify.report import charts
from identify.report.certificate import Issue, foot, head
from identify.report.findings import chosen, findings
from identify.report.history import history
from identify.report.ladder import ways
from identify.report.page import folded, page, table, view
from identify.report.scene import scene
from identify.uncertainty.promise import INTERVAL
from identify.uncertainty.zone_map import zone_map

BEYOND = 3.0  # tolerances: a face further off than that stands elsewhere
WELL_SEEN = 0.2  # of the tolerance of a parameter that is left


def report(
    c: Calibration,
    tables: Sequence[Measurements] = (),
    verified: Verification | None = None,
    *,
    issue: Issue | None = None,
    earlier: Sequence[tuple[str, Calibration]] = (),
) -> str:
    """A self-contained HTML page: the certificate of a calibration.

    `measured` are the measurements it was made from, for the view and the faces; `earlier` calibrations of the same
    robot, by the names of their files, show what has changed since.
    """
    c = with_promise(c)
    zone = zone_map(c)
    faces = {name: face for t in tables if isinstance(t, Touches) for name, face in zip(t.ids, t.face, strict=True)}
    view_data = _scene(c, tables)
    sections = [
        head(c, issue or Issue(), tables),
        _verdict(c, verified),
        _beyond(c, verified),
        "<h2>Accuracy</h2>",
        _accuracy(c, verified),
        "" if zone is None else f"<h2>Expected tip error in the weld zone</h2>{charts.zone_slices(zone)}{ZONE}",
        "<h2>Robot, jig and touches</h2>",
        view(view_data),
        _shared(c),
        history(c, earlier),
        "<h2>Residuals</h2>",
        f'<div class="row figures">{charts.residuals_by_face(c, faces)}{charts.residuals_in_time(c)}</div>',
        findings(c),
        _outliers(c),
        chosen(c),
        f'<h2>Parameters</h2><div class="columns">{_parameters(c)}</div>',
        folded(
            "How well each direction is seen, and correlations",
            f'<div class="row">{charts.singular_values(c)}{charts.correlations(c)}</div>',
        ),
        "<h2>How to apply it</h2>",
        APPLY,
        ways(ladder(c)),
        SCALE,
        "<h2>Where it comes from</h2>",
        foot(c),
    ]
    return page(f"Calibration of {c.cell.robot.name}", "\n".join(sections), view_data)


ZONE = """<p class="soft">Torch straight down, best branch of the arm; grey is out of reach. A prediction, not a
measurement.</p>"""
APPLY = """<p>The identified robot differs from the controller's in every link. Three ways lead from here, better
ones first:</p>
<ul><li>let the off-line programming system use the calibrated model, and correct its targets through it;</li>
<li>correct finished programs point by point;</li>
<li>enter joint zeros and tool into the controller: the easiest, and it leaves the errors of the links.</li></ul>"""
SCALE = """<p>Accuracy is relative to the jig, whose certificate sets the scale. The torch's orientation is not
verified by touches.</p>"""


def _verdict(c: Calibration, verified: Verification | None) -> str:
    """What was promised and what was delivered, in one line with the definition."""
    good, sentences = True, list[str]()
    if c.promise is not None:
        sentences.append(
            f"Promised: in the weld zone the tip is within {c.promise['p95_mm']:.2f} mm at 95 % of the poses, for 95 "
            f"of 100 robots like this (RMS {c.promise['rms_mm']:.2f} mm)."
        )
    if verified is not None:
        good, e = verified.kept, verified.identified
        sentences.append(
            f"Delivered at {e.n} places that the fit has not seen: {e.p95_mm:.2f} mm at 95 % of them, promised there "
            f"{verified.promised_p95_mm:.2f} mm, {'kept' if good else 'NOT kept: the model lacks something'}; before "
            f"calibration {verified.nominal.p95_mm:.2f} mm."
        )
    elif sentences:
        sentences.append("Not verified yet: measure touches or positions that were not used.")
    else:
        sentences.append("No zone is given and nothing was verified: there is no accuracy to state.")
    return f'<p class="verdict{"" if good else " bad"}">{escape(" ".join(sentences))}</p>'


def _beyond(c: Calibration, verified: Verification | None) -> str:
    """Where the promise rests on extrapolation: joints and coordinates in which the fit had no data."""
    places = [("these unseen places", verified.beyond if verified else ()), ("the weld zone", beyond_in_zone(c))]
    sentences = [f"Of {what}, beyond the data of the fit: {'; '.join(where)}." for what, where in places if where]
    return f'<p class="soft">{escape(" ".join(sentences))}</p>' if sentences else ""


def _shared(c: Calibration) -> str:
    """What measurements share: by how much faces are off, and where further placements, tools and points are."""
    if not c.shared:
        return ""
    sigma = np.sqrt(np.diag(c.joint_covariance))[len(c.estimated) :]
    rows = []
    for value, deviation in zip(c.shared, sigma, strict=True):
        unit = 1.0 if value.unit == "mm" else np.pi / 180
        off = abs(value.value) > BEYOND * max(value.scale, 1e-12) and value.name.startswith("face.")
        rows.append(
            [
                f"{value.name.replace('face.', 'face ', 1)} [{value.unit}]",
                f"{value.value / unit:+.3f}",
                f"{INTERVAL * deviation / unit:.3f}",
                "stands elsewhere than the jig file says" if off else "",
            ]
        )
    return "<h2>Faces, placements, tools</h2>" + table(["", "value", "+- (95 %)", ""], rows, (3,))


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


def _scene(c: Calibration, tables: Sequence[Measurements]) -> dict[str, object]:
    ids = tuple(name for t in tables for name in t.ids)
    faces = tuple(face for t in tables for face in (t.face if isinstance(t, Touches) else ("",) * len(t)))
    q = np.concatenate([t.q for t in tables]) if tables else np.empty((0, len(c.cell.robot.joints)))
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
    errors = {name for name, _, _ in c.cell.robot.error_parameters}
    small = {i for i in c.index if names[i] in errors and abs(c.theta[i]) < INTERVAL * c.sigma[i]}
    rows = []
    for i, name in enumerate(names):
        if i in small:
            continue
        status, sigma = c.status(name), INTERVAL * c.sigma[i] / unit[i]
        level = "well seen" if c.sigma[i] < WELL_SEEN * c.cell.prior[i] else "partly seen"
        sight = {"estimated": "weak: tolerances tell more" if name in c.weak else level, "fixed": "fixed by the user"}
        words = sight.get(status) or _carried(c, name)
        value, start = c.theta[i] / unit[i], c.start[i] / unit[i]
        estimated, digits = status == "estimated", c.cell.robot.decimals[i]
        rows.append(
            [
                f"{name} [{c.cell.robot.units[i]}]",
                f"{start:.{digits}f}",
                f"{value:.{digits}f}" if estimated else "",
                f"{value - start:+.{digits}f}" if estimated else "",
                f"{sigma:.{digits}f}" if estimated else "",
                words,
            ]
        )
    words = f"{len(small)} joint errors are zero within their uncertainty; calibration.json holds them all."
    note = f'<p class="soft">{words}</p>' if small else ""
    return table(["parameter", "start", "identified", "change", "+- (95 %)", ""], rows, (5,)) + note


def _carried(c: Calibration, name: str) -> str:
    terms = c.combinations.get(name, {})
    if not terms:
        return "eliminated: no effect on the tip"
    return "eliminated, carried by " + ", ".join(f"{value:+.4g} {carrier}" for carrier, value in terms.items())
