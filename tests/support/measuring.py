"""Readings of a hidden robot written where a person writes them: into the table beside a plan."""

import csv

import numpy as np

from identify.model.io.measurements import read_measurements
from identify.model.touch import Contacts, Distances
from probe.virtual.readings import readings

BLANK = {"distance_mm": 500.0, "x_mm": 1000.0, "y_mm": 0.0, "z_mm": 0.0}


def filled(table, cell, theta, rng, further, path):
    """The table `table` filled with what a robot `theta` gives, as the file `path`."""
    with table.open() as file:
        rows = list(csv.DictReader(file))
    drafts = [{key: value or BLANK[key] for key, value in row.items()} for row in rows]
    for k, row in enumerate(drafts):
        if "x_mm" in row:
            row["x_mm"] = 1000.0 + k  # not all in one place
    _write(path, drafts)
    (planned,) = read_measurements(path, cell)
    made = readings(cell, planned, theta, rng, further)
    if isinstance(made, Distances):
        columns = {"distance_mm": made.distance}
    elif isinstance(made, Contacts):
        names = [name for name in rows[0] if name.startswith("q")]
        columns = dict(zip(names, np.degrees(made.q).T, strict=True))
        rows = [row for row in rows if row["id"] in set(made.ids)]
    else:
        columns = dict(zip(("x_mm", "y_mm", "z_mm"), made.point.T, strict=True))
    _write(path, [row | {key: values[k] for key, values in columns.items()} for k, row in enumerate(rows)])


def _write(path, rows):
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
