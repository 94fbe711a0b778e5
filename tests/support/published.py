"""The library's cell, and published arms before the jigs that stand beside the checkout."""

from pathlib import Path

from identify.model.cell import Cell
from identify.model.io.description import library, read_cell

PUBLISHED = """\
robot: {{urdf: {folder}/robots/{urdf}, base: base_link, flange: tool0}}
jig: {folder}/jigs/{jig}.yaml
base: {{x_mm: {x}, y_mm: {y}, z_mm: {z}, rz_deg: -90, ry_deg: 0, rx_deg: 0}}
tool: {{x_mm: {out}, y_mm: 0, z_mm: {long}, rz_deg: 0, ry_deg: {bend}, rx_deg: 0}}
wire: {{radius_mm: 0.6, shape: flat}}
touch: {{sigma_mm: 0.05, approach_mm: 25, travel_mm: 60, speed_mm_s: 5, max_tilt_deg: 50}}
zone: {{box_mm: [[0, 400], [0, 300], [0, 250]], max_tilt_deg: 60}}
controller: {{port: sim, protocol: line}}
"""
M10IA = {"urdf": "fanuc_m10ia_support/urdf/m10ia.urdf", "jig": "u-fixture", "x": 200, "y": 1100, "z": -150}
KR5 = {"urdf": "kuka_kr5_support/urdf/kr5_arc.urdf", "jig": "cube150", "x": 75, "y": 1025, "z": -100}
CELLS = {
    "library": (33, None),
    "M-10iA on the U": (40, M10IA | {"out": 40, "long": 350, "bend": 22}),
    "KR5 on the cube": (40, KR5 | {"out": 60, "long": 360, "bend": 35}),
}


def published_cell(name: str, shared_data: Path, folder: Path) -> tuple[int, Cell]:
    """The number of touches that such a cell is planned with, and the cell; its file is written into the folder."""
    n, published = CELLS[name]
    path = library("cells")["arc-welder"]
    if published is not None:
        path = folder / "cell.yaml"
        path.write_text(PUBLISHED.format(folder=shared_data, **published))
    return n, read_cell(path)
