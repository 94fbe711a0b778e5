"""`touchcal init` and `touchcal schema`."""

from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from identify.model.files import InputError, nearest, read_bytes, read_text, write_bytes, write_text
from oed.cli.options import print_json

if TYPE_CHECKING:
    from identify.model.cell import Cell
    from identify.model.jig import Jig
    from identify.model.robot import Robot

MESHES = "meshes"  # folder beside the URDF
Kind = Literal["cell", "robot", "jig"]
Measure = Literal["touch", "tracker", "ballbar", "sockets"]
KINDS = {"tracker": "position", "ballbar": "distance", "sockets": "contact"}  # that each of these measures
SCHEMA = "cell.schema.json"
FEW = 200  # touches that are searched for at a place of the base
PAPER = "arc-welder"  # the paper's robot, which stands where the paper puts it


def init(
    directory: Path,
    *,
    robot: str = "arc-welder",
    jig: str = "step-block",
    urdf: Path | None = None,
    base_link: str | None = None,
    flange_link: str | None = None,
    measure: Measure = "touch",
    force: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Make a commented cell folder to start from.

    Writes cell.yaml, its schema for editors, and an empty pendant.csv for touchcal check. Of a URDF, the flange is the
    frame whose z axis points out of the wrist; the base stands where the jig is reached; tolerances are those of a
    catalogue arm. For example:

        touchcal init mycell --robot irb120 --jig cube

        touchcal init mycell --robot fanuc_m10ia_support

        touchcal init mycell --robot irb120 --measure ballbar

    Parameters
    ----------
    directory
        The folder to make.
    robot
        A robot of the library: arc-welder, arm7, irb120, puma560, scara; or a URDF, or the folder of its package.
    jig
        A jig of the library: step-block, cube; or a jig file, which is copied into the folder.
    urdf
        A URDF in place of a robot of the library; it is copied into the folder, with the meshes of its collisions.
    base_link
        The link that the chain begins at; any of the URDF, if not the arm's own base.
    flange_link
        The link that carries the tool; any of the URDF, if not the arm's own flange.
    measure
        What measures: touch, a wire that touches the jig; tracker, positions of the tip; ballbar, distances of the tip
        from anchors; sockets, in which a ball at the tip sits. The last three need no jig.
    force
        Overwrite a cell.yaml that is there already.
    """
    from identify.model.io.template import cell_text, measure_text

    if (directory / "cell.yaml").exists() and not force:
        raise InputError(f"{directory / 'cell.yaml'} is there already; choose another folder, or say --force")
    named = urdf or (Path(robot) if robot.lower().endswith((".urdf", ".xacro")) or Path(robot).is_dir() else None)
    described, source, outward, words = _robot(robot, named, base_link, flange_link)
    block, block_file, block_source = _jig(jig)
    cell, notes = _first_cell(described, block, outward)
    _make(directory)
    if source is not None:
        write_text(directory / source.name, _with_meshes(source, described, directory))
    if block_file is not None and block_file.resolve() != (directory / block_file.name).resolve():
        write_bytes(directory / block_file.name, read_bytes(block_file))
    text = cell_text(cell, words, block_source, notes, SCHEMA)
    if measure != "touch":
        text = text.replace(f"jig: {block_source}\n", "") + measure_text(measure, cell)
    _write(directory, text, described, measure)


def _make(directory: Path) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: cannot be made: {error.strerror}; choose another folder") from None


def _write(directory: Path, text: str, robot: "Robot", measure: Measure) -> None:
    """The cell, its schema and an empty table of poses; and what to do next."""
    from identify.model.io.tables import POINT, joint_columns
    from identify.pendant import EULER

    write_text(directory / "cell.yaml", text)
    write_text(directory / SCHEMA, dumps(schema_of("cell"), indent=1) + "\n")
    write_text(directory / "pendant.csv", ",".join(["id", *joint_columns(robot), *POINT, *EULER]) + "\n")
    kind = f"\nand: touchcal plan --kinds {KINDS[measure]} --budget 20min" if measure != "touch" else ""
    print(
        f"wrote {directory}: measure base and tool in cell.yaml, read a few poses off the pendant into pendant.csv,\n"
        f"then: touchcal check --cell {directory / 'cell.yaml'} --pendant {directory / 'pendant.csv'}{kind}"
    )


def _robot(
    name: str, urdf: Path | None, base: str | None, flange: str | None
) -> tuple["Robot", Path | None, np.ndarray, str]:
    """The robot, its URDF, where its flange looks to, and what cell.yaml says of it."""
    from identify.model.io.description import LIBRARY, read_robot

    if urdf is None:
        return read_robot(_known("robots", name)), None, np.array([0.0, 0.0, 1.0]), LIBRARY + name
    from identify.model.urdf.chain import read_urdf
    from identify.model.urdf.ends import ends, urdf_file

    file = urdf_file(urdf)
    links = ends(file, base, flange)
    print(f"chain from '{links.base}' to '{links.flange}': {links.why}")
    words = f"{{urdf: {file.name}, base: {links.base}, flange: {links.flange}}}"
    return read_urdf(file, links.base, links.flange), file, links.outward, words


def _jig(name: str) -> tuple["Jig", Path | None, str]:
    """The jig, its file where it is the user's own, and what cell.yaml says of it."""
    from identify.model.io.description import LIBRARY, read_jig

    if Path(name).suffix in (".yaml", ".yml"):
        return read_jig(Path(name)), Path(name), Path(name).name
    return read_jig(_known("jigs", name)), None, LIBRARY + name


def _first_cell(robot: "Robot", jig: "Jig", outward: np.ndarray) -> tuple["Cell", dict[str, str]]:
    """The cell to start from: the paper's for its own robot, else one whose base reaches the jig."""
    from dataclasses import replace

    from identify.model.base_placement import starting_cell
    from identify.model.cell import Priors

    if robot.name != PAPER:
        return starting_cell(robot, jig, outward, _touches)
    cell, _ = starting_cell(robot, jig, outward)
    base, tool = [340.0, 740.0, 350.0, -np.pi / 2, 0.0, 0.0], [0.0, 0.0, 410.0, 0.0, -np.pi / 10, 0.0]
    return replace(cell, base=np.array(base), tool=np.array(tool), priors=Priors()), {}


def _touches(cell: "Cell") -> np.ndarray:
    """Feasible touches on each face, of a few that are searched for."""
    from oed.candidates.candidates import candidates

    try:
        return candidates(cell, np.random.default_rng(0), FEW).number
    except InputError:
        return np.zeros(len(cell.the_jig.faces), dtype=int)


def _with_meshes(urdf: Path, robot: "Robot", directory: Path) -> str:
    """The text of a URDF whose collision meshes lie in a folder beside it; they are copied there."""
    text, names = read_text(urdf), dict[Path, str]()
    for shape in robot.shapes:
        if shape.path is None or not shape.file:
            continue
        others = {name for path, name in names.items() if path != shape.path}
        name = names.setdefault(shape.path, shape.path.name)
        while name in others:
            name = names[shape.path] = f"{shape.link}-{name}"
        (directory / MESHES).mkdir(exist_ok=True)
        write_bytes(directory / MESHES / name, read_bytes(shape.path))
        for quote in "\"'":
            text = text.replace(f"filename={quote}{shape.file}{quote}", f"filename={quote}{MESHES}/{name}{quote}")
    return text


def _known(kind: str, name: str) -> Path:
    from identify.model.io.description import library

    names = library(kind)  # type: ignore[arg-type]
    if name not in names:
        raise InputError(f"the library has no {kind[:-1]} '{name}'{nearest(name, names)}; it has {', '.join(names)}")
    return names[name]


def schema(kind: Kind = "cell") -> None:
    """Print the JSON schema of cell.yaml, robot.yaml or jig.yaml, by which editors check and complete it.

    touchcal init writes that of the cell beside cell.yaml, whose first line names it for editors that use the YAML
    language server. Example:

        touchcal schema jig > jig.schema.json

    Parameters
    ----------
    kind
        The file to describe.
    """
    print_json(schema_of(kind))


def schema_of(kind: Kind) -> dict[str, Any]:
    """The schema of a file that a user writes, from the model that validates it."""
    from pydantic import BaseModel

    from identify.model.io.schema import CellFile, JigFile, RobotFile

    models: dict[Kind, type[BaseModel]] = {"cell": CellFile, "robot": RobotFile, "jig": JigFile}
    return models[kind].model_json_schema()
