"""`touchcal check`."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from identify.model.files import InputError, write_text
from oed.cli.options import CellFile, Json, load_cell, print_json

if TYPE_CHECKING:
    from identify.model.cell import Cell
    from identify.model.joint_counting import JointCounting
    from identify.pendant import Agreement


def check(
    *,
    cell: CellFile = Path("cell.yaml"),
    pendant: Path | None = None,
    fix: Annotated[bool, Parameter(negative=())] = False,
    json: Json = False,
) -> int:
    """Validate the cell, and compare its model with poses read off the pendant.

    Exit code 2 where the robot reaches nothing of the zone or can touch nothing of the jig, each with the reason. Exit
    code 1 where model and pendant disagree; the usual causes are tried (axis signs, joint 3 coupled to joint 2,
    offsets of a right angle, flange or tip, base height, order of the angles, mm or m), and the one that explains it is
    named. How the controller counts its joints (axis signs, coupling, zeros) is proposed as `joints:` of the cell, and
    written there with --fix; where all agree, --fix writes that no joint is counted together with another.
    pendant.csv has columns id, q1_deg ... qN_deg, x_mm, y_mm, z_mm, w_deg, p_deg, r_deg. A page beside the cell file
    shows robot, torch, jig and zone. For example:

        touchcal check --pendant pendant.csv

        touchcal check --pendant pendant.csv --fix

    Parameters
    ----------
    pendant
        Poses read off the pendant: joints, and the tool's place in the robot's base frame.
    fix
        Write the proposed `joints:` into the cell file; its comments stay.
    """
    from identify.model.identifiability import structure
    from identify.model.io.document import Document
    from identify.pendant import compare, read_pendant

    described = load_cell(cell)
    if fix and pendant is None:
        raise InputError("--fix writes what the pendant shows; say --pendant FILE too")
    agreement = None if pendant is None else compare(described, read_pendant(pendant, described))
    counting = _to_write(described, agreement) if fix else None
    if pendant and counting:
        write_text(cell, Document(cell).with_key("joints", _entry(described, counting) or None))
        if not json:
            print(f"wrote {_line(described, counting)} into {cell}")
        described = load_cell(cell)
        agreement = compare(described, read_pendant(pendant, described))
    useless = _useless(described)
    if json:
        answer = {"robot": described.robot.name, "rank": structure(described).rank, "useless": useless}
        print_json(answer | {"pendant": agreement and asdict(agreement)})
    else:
        text = "\n".join([*story(described), *_pendant(described, agreement), *_next(useless, agreement, cell)])
        print(text)
        print(_picture(described, cell, text))
    return 2 if useless else 0 if agreement is None or agreement.agrees else 1


def _useless(cell: "Cell") -> list[str]:
    """Why this cell can do nothing: a zone that is not reached, a jig of which nothing can be touched."""
    from identify.model.zone import zone_poses
    from identify.report.cell import POSTURES
    from oed.candidates.candidates import candidates

    if cell.base is None or cell.tool is None:  # where they stand is not known yet
        return []
    sentences = list[str]()
    for part, look in (
        (cell.zone, lambda: zone_poses(cell, poses=POSTURES)),
        (cell.jig, lambda: candidates(cell, np.random.default_rng(0), 1)),
    ):
        try:
            _ = part is None or look()
        except InputError as error:
            sentences.append(str(error))
    return sentences


def _to_write(cell: "Cell", agreement: "Agreement | None") -> "JointCounting | None":
    """The counting that the pendant shows, where the cell does not say it."""
    if agreement is None or not agreement.explained:
        return None
    as_model = agreement.agrees and not cell.robot.counting.stated
    return replace(cell.robot.counting, uncoupled=True) if as_model else agreement.counting


def _picture(described: "Cell", cell: Path, text: str) -> str:
    """Draw the page beside the cell file; the sentence that says so, or why there is none."""
    from identify.report.cell import cell_page

    page = cell.with_suffix(".html")
    try:
        write_text(page, cell_page(described, text))
    except InputError as error:
        return f"no picture: {error}"
    return f"look at {page}: robot, torch, jig and zone"


def story(cell: "Cell") -> list[str]:
    """What a person wants to see again of the cell file."""
    from identify.model.cell import DEG
    from identify.model.identifiability import structure

    result = structure(cell)
    lines = [
        f"robot {cell.robot.name}: {len(cell.robot.joints)} joints ({cell.robot.kinds}), {result.rank} of "
        f"{len(result.names)} parameters can be identified",
        "jig: none" if cell.jig is None else f"jig {cell.jig.name}: {len(cell.jig.faces)} faces, {_sides(cell)}",
        f"touches: {cell.touch.speed:g} mm/s, at most {cell.touch.max_tilt / DEG:g} degrees off the normal",
    ]
    if cell.zone is not None:
        box = " x ".join(f"{lo:g} ... {hi:g}" for lo, hi in cell.zone.box)
        lines.append(f"zone: {box} mm, torch within {cell.zone.max_tilt / DEG:g} degrees of straight down")
    lines += _shapes(cell)
    if cell.robot.counting.differs:
        lines.append(f"the controller counts otherwise than the model: {_line(cell, cell.robot.counting)}")
    return lines


def _shapes(cell: "Cell") -> list[str]:
    """How the arm is kept clear of jig and itself."""
    from probe.motion.bodies import notes
    from probe.motion.clearance import Clearance

    if not cell.robot.shapes:
        alone = "arm: its file describes no shapes of links; torch and wire alone are kept clear of the jig"
        return [] if cell.robot.capsules else [alone]
    clearance = Clearance(cell, cell.theta)
    judge = "capsules around them" if clearance.exact is None else "solids"
    links = ", ".join(dict.fromkeys(body.shape.name for body in clearance.bodies)) or "none"
    return [f"arm: {len(clearance.bodies)} collision shapes judged as {judge}, of links {links}", *notes(cell.robot)]


def _sides(cell: "Cell") -> str:
    sides = {
        "+-"[int(n.max() < -n.min())] + "xyz"[int(abs(n).argmax())] for n in (f.normal for f in cell.the_jig.faces)
    }
    return "looking along " + ", ".join(sorted(sides))


def _entry(cell: "Cell", counting: "JointCounting") -> dict[str, Any]:
    from identify.model.io.joint_counting import counting_entry

    return counting_entry(counting, [joint.name for joint in cell.robot.joints])


def _line(cell: "Cell", counting: "JointCounting") -> str:
    """The line of cell.yaml that says how the controller counts."""
    from identify.model.io.document import line_text

    entry = _entry(cell, counting)
    return line_text("joints", entry) if entry else "no joints:"


def _next(useless: list[str], agreement: "Agreement | None", file: Path) -> list[str]:
    """Whether the cell can be worked with, and what is to be done next."""
    if useless:
        lines = [f"this cell can do nothing: {sentence}" for sentence in useless]
        return [*lines, f"correct base, tool and zone in {file}: lengths are millimetres, angles degrees"]
    named = "" if file == Path("cell.yaml") else f"--cell {file} "
    compare = f"touchcal check {named}--pendant {file.parent / 'pendant.csv'}"
    return [] if agreement else [f"cell is valid; compare it with the pendant: {compare}"]


def _pendant(cell: "Cell", agreement: "Agreement | None") -> list[str]:
    """What the pendant says to the cell."""
    if agreement is None:
        return []
    if agreement.agrees:
        return [f"pendant: agrees within {agreement.position_mm:.2f} mm and {agreement.angle_deg:.2f} degrees"]
    lines = [f"pendant: DISAGREES by up to {agreement.position_mm:.1f} mm and {agreement.angle_deg:.1f} degrees"]
    if not agreement.explained:
        return [*lines, "none of the usual causes explains it; compare the link lengths with the robot's drawing"]
    lines += [f"  because {cause.name}: {cause.cure}" for cause in agreement.causes]
    if agreement.counting is None:
        return lines
    return [*lines, "write this line into cell.yaml, or say --fix:", f"  {_line(cell, agreement.counting)}"]
