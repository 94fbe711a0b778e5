"""A cell, a robot and a jig as YAML, and what reading says of mistakes in them."""

from pathlib import Path

import pytest

from identify.model.files import InputError
from identify.model.io.description import read_cell

CELL = """\
robot: robot.yaml
jig: jig.yaml
base: {x_mm: 340, y_mm: 740, z_mm: 350, rz_deg: -90}
tool:
  z_mm: 410
  ry_deg: -18
touch: {sigma_mm: 0.05, approach_mm: 25}
zone: {box_mm: [[0, 400], [0, 300], [0, 250]], max_tilt_deg: 60}
fixed: [j1.beta]
bounds: {j2.a: [340, 360]}
"""
ROBOT = """\
name: elbow
joints:
  - {d_mm: 400, alpha_deg: -90, limits_deg: [-160, 160]}
  - {a_mm: 350, limits_deg: [-110, 130], speed_deg_s: 100}
  - {type: prismatic, limits_mm: [0, 200], speed_mm_s: 300}
capsules:
  - {link: 2, start_mm: [0, 0, 0], end_mm: [0, 0, 100], radius_mm: 40}
"""
JIG = """\
name: corner
faces:
  - {name: top, origin_mm: [0, 0, 100], u_mm: [100, 0, 0], v_mm: [0, 100, 0], tolerance_mm: 0.02}
  - {name: right, origin_mm: [100, 0, 0], u_mm: [0, 100, 0], v_mm: [0, 0, 100]}
boxes:
  - {lower_mm: [0, 0, 0], upper_mm: [100, 100, 100]}
"""


def mistakes(path, read=read_cell):
    """Mistakes as "file:line: sentence", without folders."""
    with pytest.raises(InputError) as caught:
        read(path)
    return [f"{Path(m.file).name}:{m.line}: {m.text}" for m in caught.value.mistakes]


def change(text, old, new):
    assert old in text
    return text.replace(old, new)
