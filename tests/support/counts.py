"""A controller that counts its joints in an odd way."""

from identify.model.io.description import library
from identify.model.joint_counting import JointCounting

ODD = JointCounting((1, -1, 1, 1, -1, 1), (0.0, 90.0, 0.0, -12.5, 0.0, 180.0), ((2, 1, 1), (4, 3, -1)), (100.0,) * 6)


def cell_text(*lines):
    text = library("cells")["arc-welder"].read_text()
    return text + "\n".join(lines) + "\n"
