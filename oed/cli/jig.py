"""`touchcal jig`."""

import os
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from identify.model.files import InputError, write_text

HEAD = """\
# A jig from the planar faces of {part}: check names and places, delete faces that are not machined, and say how
# exactly they stand (tolerance_mm, 1 sigma). Arm and torch keep clear of the part itself; add the table below it.
name: {name}
source: touchcal jig {part}
faces:
"""


def jig(
    part: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])] = Path("jig.yaml"),
    scale: float = 1.0,
    tolerance: float = 0.02,
) -> int:
    """Propose a jig.yaml from the mesh of a part: planar faces that a wire can reach, named by place.

    The mesh (STL or OBJ) stands in the jig frame, z up. Faces are rectangles of at least 10 mm with 40 mm of room
    before them that do not look down; a face that is no rectangle gives the largest rectangles in it, which overlap.
    The mesh is named in jig.yaml as an obstacle, and has to stay where it is. Example:

        touchcal jig part.stl -o jig.yaml

    Parameters
    ----------
    part
        STL or OBJ file.
    output
        Where to write the jig.
    scale
        Millimetres per unit of the file: 1000 for a part in metres.
    tolerance
        How far a face may stand off its drawing [mm, 1 sigma].
    """
    from identify.model.io.facets import faces_of
    from identify.model.meshes import READERS, read_mesh

    if part.suffix.lower() not in READERS:
        raise InputError(f"{part}: a mesh is a file {' or '.join(READERS)}; export the part as one of these")
    if scale <= 0 or tolerance < 0:
        raise InputError(f"scale {scale:g} and tolerance {tolerance:g}: expected above 0, and 0 or more")
    vertices, triangles = read_mesh(part)
    faces = faces_of((vertices * scale, triangles))
    if not faces:
        raise InputError(
            f"{part}: no planar face of 10 mm that a wire reaches from above; is the part in millimetres (--scale 1000 "
            "for metres), and is z up?"
        )
    lines = [HEAD.format(part=part.name, name=part.stem)]
    for face in faces:
        places = (f"{key}_mm: {_vector(getattr(face, key).tolist())}" for key in ("origin", "u", "v"))
        lines.append(f"  - {{name: {face.name}, {', '.join(places)}, tolerance_mm: {tolerance:g}}}\n")
    unit = "" if scale == 1 else f", scale: {scale:g}"
    lines.append(f"obstacles:\n  - {{name: {part.stem}, mesh: {_beside(part, output)}{unit}}}\n")
    write_text(output, "".join(lines))
    print(f"{output}: {len(faces)} faces of {part.name}")
    return 0


def _vector(values: list[float]) -> str:
    return "[" + ", ".join(f"{round(value, 5) + 0.0!r}" for value in values) + "]"


def _beside(part: Path, output: Path) -> str:
    """The mesh as seen from the folder of the jig."""
    return Path(os.path.relpath(part, output.parent)).as_posix()
