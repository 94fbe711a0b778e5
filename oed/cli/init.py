"""`touchcal init`."""

from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import Parameter

from identify.model.files import InputError, nearest, read_bytes, read_text, write_bytes, write_text
from oed.cli.schema import schema_of

if TYPE_CHECKING:
    from identify.model.jig import Jig
    from identify.model.robot import Robot

MESHES = "meshes"  # folder beside the URDF

SCHEMA = "cell.schema.json"
CELL = """\
# yaml-language-server: $schema={schema}
# The cell: the one file to write. Lengths are millimetres, angles degrees; touchcal check says what is wrong with it.

robot: {robot}
jig: {jig}

# Where the robot stands: its base frame seen from the jig frame, Trans(x, y, z) Rz Ry Rx. A tape measure is enough.
base: {{x_mm: {x:.0f}, y_mm: {y:.0f}, z_mm: {z:.0f}, rz_deg: -90, ry_deg: 0, rx_deg: 0}}

# What it carries: the tip of the wire seen from the flange. The tool frame on the pendant will do.
tool: {{x_mm: 0, y_mm: 0, z_mm: {tool:.0f}, rz_deg: 0, ry_deg: -18, rx_deg: 0}}

# The end of the wire: a cut wire is flat, a melted one a ball. Cut it before the touches and lock the wire brake.
wire: {{radius_mm: 0.6, shape: flat}}

# How touches are made: scatter of one touch, way from approach to face, longest search, search speed, largest tilt.
touch: {{sigma_mm: 0.05, approach_mm: 25, travel_mm: 60, speed_mm_s: 5, max_tilt_deg: 50}}

# Where accuracy counts: a box in the jig frame, and how far the torch leans there from straight down.
zone: {{box_mm: [[{lo[0]:.0f}, {hi[0]:.0f}], [{lo[1]:.0f}, {hi[1]:.0f}], [{lo[2]:.0f}, {hi[2]:.0f}]], max_tilt_deg: 60}}

# How wrong the numbers above and the robot's drawing may be, 1 sigma.
priors: {{base_mm: 10, base_deg: 2, tool_mm: 10, tool_deg: 2, length_mm: 3, angle_deg: 1}}

# How the controller counts its joints, if pendant and model differ; touchcal check --pendant proposes this line. Files
# that controller or pendant read or write (plan.csv, touches.csv, pendant.csv, programs, the line) hold its numbers.
# joints: {{sign: {{{joints[0]}: -1}}, zero_deg: {{{joints[1]}: 90}}, coupled: {{{joints[2]}: {joints[1]}}}}}

# Joint errors beyond geometry, once touches have chosen them (touchcal identify --errors auto).
# errors: [harmonics, compliance, backlash]

# The serial line: /dev/ttyUSB0, COM5, socket://192.168.0.5:5007; sim is the embedded virtual robot.
controller: {{port: sim, protocol: line}}
"""


def init(
    directory: Path,
    *,
    robot: str = "arc-welder",
    jig: str = "step-block",
    urdf: Path | None = None,
    base_link: str = "base_link",
    flange_link: str = "flange",
    force: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Make a commented cell folder to start from.

    Writes cell.yaml, its schema for editors, and an empty pendant.csv for touchcal check. Example:

        touchcal init mycell --robot irb120 --jig cube

    Parameters
    ----------
    directory
        The folder to make.
    robot
        A robot of the library: arc-welder, arm7, irb120, puma560, scara; or a file that ends in .urdf, as with --urdf.
    jig
        A jig of the library: step-block, cube.
    urdf
        A URDF in place of a robot of the library; it is copied into the folder, with the meshes of its collisions.
    base_link
        The URDF's link that stands still.
    flange_link
        The URDF's link that carries the tool.
    force
        Overwrite a cell.yaml that is there already.
    """
    from identify.model.io.description import LIBRARY, read_jig, read_robot
    from identify.model.io.tables import POINT, joint_columns
    from identify.pendant import EULER

    if (directory / "cell.yaml").exists() and not force:
        raise InputError(f"{directory / 'cell.yaml'} is there already; choose another folder, or say --force")
    if urdf is None and robot.lower().endswith(".urdf"):
        urdf = Path(robot)
    if urdf is None:
        described, source = read_robot(_known("robots", robot)), LIBRARY + robot
    else:
        from identify.model.urdf.chain import read_urdf

        described = read_urdf(urdf, base_link, flange_link)
        source = f"{{urdf: {urdf.name}, base: {base_link}, flange: {flange_link}}}"
    block = read_jig(_known("jigs", jig))
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: cannot be made: {error.strerror}; choose another folder") from None
    if urdf is not None:
        write_text(directory / urdf.name, _with_meshes(urdf, described, directory))
    write_text(directory / "cell.yaml", cell_text(source, LIBRARY + jig, described, block))
    write_text(directory / SCHEMA, dumps(schema_of("cell"), indent=1) + "\n")
    header = ["id", *joint_columns(described), *POINT, *EULER]
    write_text(directory / "pendant.csv", ",".join(header) + "\n")
    print(
        f"wrote {directory}: measure base and tool in cell.yaml, read a few poses off the pendant into pendant.csv,\n"
        f"then: touchcal check --cell {directory / 'cell.yaml'} --pendant {directory / 'pendant.csv'}"
    )


def _with_meshes(urdf: Path, robot: "Robot", directory: Path) -> str:
    """The text of a URDF whose collision meshes lie in a folder beside it; they are copied there."""
    text, names = read_text(urdf), dict[Path, str]()
    for shape in robot.shapes:
        if shape.path is None or not shape.file:
            continue
        taken = {name for path, name in names.items() if path != shape.path}
        name = names.setdefault(shape.path, shape.path.name)
        while name in taken:
            name = names[shape.path] = f"{shape.link}-{name}"
        (directory / MESHES).mkdir(exist_ok=True)
        write_bytes(directory / MESHES / name, read_bytes(shape.path))
        for quote in "\"'":
            text = text.replace(f"filename={quote}{shape.file}{quote}", f"filename={quote}{MESHES}/{name}{quote}")
    return text


def _known(kind: str, name: str) -> Path:
    from identify.model.io.description import library

    known = library(kind)  # type: ignore[arg-type]
    if name not in known:
        raise InputError(f"the library has no {kind[:-1]} '{name}'{nearest(name, known)}; it has {', '.join(known)}")
    return known[name]


def cell_text(source: str, jig_source: str, robot: "Robot", jig: "Jig") -> str:
    """A cell file whose robot stands where it reaches the jig, facing it."""
    corners = np.concatenate([[f.origin, f.origin + f.u + f.v] for f in jig.faces])
    lo, hi = corners.min(axis=0), corners.max(axis=0)
    middle = (lo + hi) / 2
    reach = float(sum(np.hypot(joint.a, joint.d) for joint in robot.joints))
    if robot.name == "arc-welder":  # as the paper places it
        x, y, z, tool = 340.0, 740.0, 350.0, 410.0
    else:
        tool = min(0.4 * reach, 350.0)
        x, y, z = middle[0], middle[1] + 0.55 * reach, max(0.0, 0.5 * reach - robot.joints[0].d)
    names = [joint.name for joint in robot.joints]
    return CELL.format(
        schema=SCHEMA, robot=source, jig=jig_source, joints=(names * 3)[:3], x=x, y=y, z=z, tool=tool,
        lo=lo - 50 * np.array([1, 1, 0]), hi=hi + 50,
    )  # fmt: skip
