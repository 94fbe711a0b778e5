"""What the study of the jig found, in words and in pictures."""

import numpy as np

from identify.report.svg import AFTER, BEFORE, OUT, Chart, axis, logarithmic, named, picture
from studies.engine import Table, column, where

TOUCHES, ROBOTS = 50, 200


def answer(table: Table) -> str:
    """What every change of the jig does to the error."""
    return "\n".join([_of_faces(table), _of_places(table), _of_second(table)])


def _of_faces(table: Table) -> str:
    faces = where(table, part="faces")
    promised, simulated = (
        dict(zip(faces["name"], column(faces, c), strict=True)) for c in ("promised_mm", "simulated_mm")
    )
    whole, three = promised["all faces"], promised["three faces"]
    dropped = sorted(((v / whole - 1, n) for n, v in promised.items() if n.startswith("without")), reverse=True)
    added = sorted(((v / three - 1, n) for n, v in promised.items() if n.startswith("three and")))
    return (
        f"All faces promise {whole:.4f} mm RMS ({simulated['all faces']:.4f} simulated), three {three:.4f} "
        f"({simulated['three faces']:.4f}). Dropping a face costs: "
        + ", ".join(f"{n.removeprefix('without ')} {100 * v:.1f} %" for v, n in dropped)
        + ". Adding one to the three gains: "
        + ", ".join(f"{n.removeprefix('three and ')} {-100 * v:.1f} %" for v, n in added)
        + "."
    )


def _of_places(table: Table) -> str:
    places = where(table, part="placement")
    ended = column(where(places, name="best"), "simulated_mm")
    error, looked = column(places, "promised_mm"), np.array([name != "best" for name in places["name"]])
    k = int(np.nanargmin(np.where(looked, error, np.nan)))
    at = {name: float(places[name][k]) for name in ("x_mm", "y_mm", "z_mm", "rz_deg", "ry_deg", "rx_deg")}
    return (
        f"The jig where it stands promises {error[0]:.4f} mm, the best of {int(looked.sum())} places looked at "
        f"{error[k]:.4f}, moved by ({at['x_mm']:.0f}, {at['y_mm']:.0f}, {at['z_mm']:.0f}) mm, turned by "
        f"{at['rz_deg']:.0f}° and tilted by {at['ry_deg']:.0f}° and {at['rx_deg']:.0f}°, the worst "
        f"{np.nanmax(error):.4f}; {int(np.isnan(error).sum())} cannot be touched. Robots identified with the jig at "
        f"the end of each search are off by {', '.join(f'{v:.4f}' for v in ended)} mm."
    )


def _of_second(table: Table) -> str:
    second = where(table, part="second")
    names, promised, simulated = second["name"], column(second, "promised_mm"), column(second, "simulated_mm")
    alone = np.array([n == "first place alone" for n in names])
    more = [
        f"{n.removeprefix('and ')} {a:.4f} ({b:.4f})"
        for n, a, b in zip(names, promised, simulated, strict=True)
        if n.startswith("and ")
    ]
    return (
        f"One place promises {np.median(promised[alone]):.4f} mm ({np.median(simulated[alone]):.4f} simulated), a "
        f"second one besides: {', '.join(more)}."
    )


def pictures(table: Table) -> dict[str, str]:
    """Values of faces, places looked at, and second placements."""
    return {"jig-faces": _faces_drawn(table), "jig-placement": _places_drawn(table), "jig-second": _second_drawn(table)}


def _faces_drawn(table: Table) -> str:
    faces = where(table, part="faces")
    values = np.array([column(faces, name) for name in ("promised_mm", "simulated_mm")])
    title = f"RMS tip error after {TOUCHES} touches, mm"
    names, error = named("", faces["name"]), logarithmic(title, values.ravel())
    chart = Chart("What each face of the stepped jig is worth", names, error, width=760, slanted=True)
    for shift, value, shade in zip((-0.12, 0.12), values, (AFTER, BEFORE), strict=True):
        hints = [f"{n}: {v:.4f} mm" for n, v in zip(faces["name"], value, strict=True)]
        chart.dots(np.arange(len(value)) + shift, chart.y.scaled(value), shade, hints, 4)
    chart.legend([(AFTER, "promised"), (BEFORE, f"simulated, median of {ROBOTS} robots")])
    return picture(chart)


def _places_drawn(table: Table) -> str:
    places = where(table, part="placement")
    error = column(places, "promised_mm")
    tilt = np.hypot(column(places, "ry_deg"), column(places, "rx_deg"))
    good, best = np.isfinite(error), np.array([name == "best" for name in places["name"]])
    still = (tilt == 0) & ~best
    title = f"promised RMS tip error of {TOUCHES} touches, mm"
    wide, high = axis("tilt of the jig, deg", tilt, zero=True), logarithmic(title, error)
    chart = Chart("Where the searches for the best place of the jig looked", wide, high)
    for which, shade, size in ((good & ~best & ~still, AFTER, 3), (good & still, OUT, 5), (good & best, BEFORE, 5)):
        hints = [f"{v:.4f} mm" for v in error[which]]
        chart.dots(tilt[which], chart.y.scaled(error[which]), shade, hints, size)
    chart.legend([(AFTER, "looked at"), (OUT, "as the jig stands now"), (BEFORE, "best of each search")])
    return picture(chart)


def _second_drawn(table: Table) -> str:
    second = where(table, part="second")
    value = column(second, "promised_mm")
    kinds = {"first place alone": OUT, "place unknown": BEFORE, "place known": AFTER}
    at = [i // 3 for i in range(len(value))]
    names = [n.removeprefix("and ").removesuffix(", place known") for n in second["name"] if n.endswith("place known")]
    names = [
        n.replace("turned by", "turned").replace("°, 150 mm higher", "° and up") for n in names
    ]  # short enough to stand slanted
    title = f"promised RMS tip error of {TOUCHES} touches, mm"
    wide, high = named("", names), axis(title, value, zero=True)
    chart = Chart("What a second placement of the jig buys", wide, high, width=620, slanted=True)
    for shift, (kind, shade) in zip((-0.15, 0.0, 0.15), kinds.items(), strict=True):
        which = [i for i, n in enumerate(second["name"]) if n.endswith(kind)]
        hints = [f"{second['name'][i]}: {value[i]:.4f} mm" for i in which]
        chart.dots(np.array([at[i] for i in which]) + shift, value[which], shade, hints, 4)
    chart.legend([(shade, kind) for kind, shade in kinds.items()])
    return picture(chart)
